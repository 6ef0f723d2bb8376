"""How a command ends: exit status and at most one line, whatever happened that a user can bring about."""

from __future__ import annotations

import errno
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from reproduce.errors import Stopped

DISK = (
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EIO,
    errno.EROFS,
)  # full, in one way or another, or broken


class Terminated(BaseException):
    """SIGTERM, raised like KeyboardInterrupt, so that everything is closed on the way out."""


def status_of(command: Callable[[], int]) -> int:
    """Runs ``command``; its exit status, or that of its end.

    2: an error of the project, or a full disk; 130: interrupted; 143: terminated; 141: nobody reads stdout any more
    (``| head``).
    """
    try:
        with _terminated_like_interrupted():
            try:
                return command()
            finally:
                sys.stdout.flush()
    except ValueError as error:
        return _say(str(error), 2)
    except Stopped:  # the training has said so
        return 128 + signal.SIGINT
    except KeyboardInterrupt:
        return _say("interrupted", 128 + signal.SIGINT)
    except Terminated:
        return _say("terminated", 128 + signal.SIGTERM)
    except BrokenPipeError:
        if not _reader_gone():
            raise
        return 128 + signal.SIGPIPE
    except OSError as error:
        if error.errno not in DISK:
            raise
        return _say(f"the disk refuses to be written to: {error}", 2)


def _say(text: str, status: int) -> int:
    print(f"reproduce: {text}", file=sys.stderr)
    return status


@contextmanager
def _terminated_like_interrupted() -> Iterator[None]:
    """Training and the workflow have handlers of their own, as long as they can do better than end."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals reach the main thread only
        return

    def handle(number: int, frame: Any) -> None:
        raise Terminated

    before = signal.signal(signal.SIGTERM, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _reader_gone() -> bool:
    """Whether it is stdout that broke, not a pipe to a worker; if so, the flush at exit has nothing to say either."""
    watch = select.poll()
    watch.register(sys.stdout.fileno(), 0)
    if not any(event & select.POLLERR for _, event in watch.poll(0)):
        return False
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return True
