"""Bullet, without the line about its build that it prints wherever it is imported: here, in every worker, in every log.

The line comes from C, past ``sys.stdout`` and ``sys.stderr``; so the descriptors themselves are turned away.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["pybullet"]


@contextmanager
def _silence() -> Iterator[None]:
    libc = ctypes.CDLL(None)

    def flush() -> None:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
        libc.fflush(None)

    flush()
    kept = {number: os.dup(number) for number in (1, 2)}
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for number in kept:
            os.dup2(nowhere, number)
        yield
    finally:
        libc.fflush(None)
        for number, copy in kept.items():
            os.dup2(copy, number)
            os.close(copy)
        os.close(nowhere)


with _silence():
    import pybullet
