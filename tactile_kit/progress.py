"""Progress for people: a bar with the time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import contextlib
import sys
import time
from typing import Any

WIDE = 130  # columns of a terminal that hold bar, numbers and what follows them


class Counter:
    """Shows ``done`` of ``total``, how fast it goes and how long it will take, on stderr.

    Args:
        total: of them at the end (more may be done: then those are all); start: done before.
        unit: what they are called; label: of what this is a part.
        quiet: show nothing; patience: s before the first plain line, so that what is short stays silent.
    """

    EVERY = 30.0  # s between plain lines

    def __init__(
        self,
        total: int,
        start: int = 0,
        label: str = "",
        unit: str = "",
        quiet: bool = False,
        patience: float = 0.0,
    ) -> None:
        self.total, self.start, self.label, self.unit, self.quiet = total, start, label, unit, quiet
        self._begin = time.monotonic()
        self._shown = self._begin + patience - self.EVERY
        self._bar: Any = None
        if not quiet and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn
            from rich.progress import Progress as Bar

            console = Console(stderr=True)
            self._narrow = console.width < WIDE
            bar = BarColumn(16 if self._narrow else 40)
            columns = (TextColumn("{task.description}"), bar, TextColumn("{task.fields[text]}"))
            self._bar = Bar(*columns, console=console)
            self._task = self._bar.add_task(label, total=total, completed=start, text="")
            self._bar.start()

    def begin(self) -> None:
        """Reckon the speed from now on: what came before was preparation."""
        self._shown += time.monotonic() - self._begin
        self._begin = time.monotonic()

    def show(self, done: int, more: str | None = "") -> None:
        """Show ``done``, followed by ``more``; None moves the bar alone and leaves the text as it was."""
        if self.quiet:
            return
        if self._bar is not None:
            text = {} if more is None else {"text": self._text(done) + self._placed(more)}
            self._bar.update(self._task, completed=done, **text)
            return
        now = time.monotonic()
        due = now - self._shown >= self.EVERY or (done >= self.total and self._shown >= self._begin)
        if more is not None and due:
            self._shown = now
            self.say(self._text(done) + more)

    def say(self, text: str) -> None:
        """One line of text."""
        if self.quiet:
            return
        if self._bar is not None:
            self._bar.console.print(f"{self.label}: {text}", highlight=False, markup=False)
        else:
            with contextlib.suppress(
                OSError
            ):  # a log on a full disk: the work is worth more than a line on it
                print(f"{self.label}: {text}", file=sys.stderr, flush=True)

    def _placed(self, more: str) -> str:
        """On a narrow terminal it has a line of its own: the bar is to be seen too."""
        return "\n" + more.removeprefix(", ") if self._narrow and more else more

    def close(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._bar.stop()

    def _text(self, now: int) -> str:
        done, total = now - self.start, max(self.total, now)
        seconds = time.monotonic() - self._begin
        left = duration(seconds / done * (total - now)) if done else "?"
        rate = done / seconds if seconds else 0.0
        speed = f"{rate:,.0f}" if rate >= 10 else f"{rate:.2g}"
        return f"{now:,}/{total:,} {self.unit}, {speed}/s, {left} left"


def duration(seconds: float) -> str:
    """95 -> '1:35', 4000 -> '1:06:40'."""
    minutes, seconds = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
