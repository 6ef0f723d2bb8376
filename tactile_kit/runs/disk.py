"""Writing in a run that lasts days, on a disk that may be full for some of them: work goes on, and says so once."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable
from pathlib import Path


class Disk:
    """Tells of each thing that could not be written, once until it could be again, and then of that.

    Args:
        say: shows a line to whoever looks on.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._refused: set[str] = set()

    def attempt(self, what: str, meanwhile: str, work: Callable[[], None]) -> bool:
        """Do ``work``, which writes ``what``; False where the system refused it (full, read-only, broken).

        ``meanwhile`` says what that means for now.
        """
        try:
            work()
        except OSError as problem:
            if what not in self._refused:
                self._refused.add(what)
                self._say(f"could not save {what} ({problem}); {meanwhile}")
            return False
        if what in self._refused:
            self._refused.discard(what)
            self._say(f"{what} can be saved again")
        return True


class Appended:
    """A file that grows by whole pieces: what the disk refuses waits in memory and goes first the next time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._waiting = b""
        self._whole = sys.maxsize  # bytes of the file that are whole pieces; before it is opened, all

    def add(self, piece: bytes) -> None:
        """Append ``piece`` after all that waits. Raises OSError; then nothing of it is in the file, and it waits."""
        self._waiting += piece
        self.flush()

    def flush(self) -> None:
        """Try again to write what waits. Raises OSError."""
        if not self._waiting:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(self.path, os.O_WRONLY | os.O_CREAT, 0o644)
        try:
            self._whole = end = min(self._whole, os.fstat(handle).st_size)
            os.ftruncate(handle, end)  # what an attempt before this one left
            data = self._waiting
            try:
                while data:
                    written = os.pwrite(handle, data, end)
                    data, end = data[written:], end + written
            except OSError:
                with contextlib.suppress(OSError):
                    os.ftruncate(handle, self._whole)  # needs no room: readers see whole pieces only
                raise
        finally:
            os.close(handle)
        self._waiting, self._whole = b"", end
