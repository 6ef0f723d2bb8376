"""Worker processes for work that falls into many independent parts."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import connection
from typing import Any


class Workers:
    """``count`` processes that play one part after another.

    They end with this process, however that comes about, and at once where the ``with`` block is left by an exception:
    whoever interrupts waits for nothing.

    Args:
        count: of the processes, at least 1.
        begin: called first in each, with ``arguments``; both must pickle.
    """

    def __init__(self, count: int, begin: Callable[..., None], arguments: tuple[Any, ...] = ()) -> None:
        context = multiprocessing.get_context("spawn")
        self._hear, self._end = context.Pipe(duplex=False)
        self._pool = ProcessPoolExecutor(count, context, _begin, (self._hear, begin, arguments))

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self._end.close()
        self._pool.shutdown(cancel_futures=True)
        self._hear.close()
        self._end.close()

    def in_order(self, function: Callable[[Any], Any], parts: Sequence[Any]) -> Iterator[Any]:
        """``function`` of every part, in the order of ``parts``."""
        for future in self._given(function, parts):
            yield future.result()

    def as_they_end(self, function: Callable[[Any], Any], parts: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        """The number of a part and ``function`` of it, whichever ends first."""
        number = {future: at for at, future in enumerate(self._given(function, parts))}
        for future in as_completed(number):
            yield number[future], future.result()

    def _given(self, function: Callable[[Any], Any], parts: Sequence[Any]) -> list[Any]:
        with light_main():  # the first part given starts the processes
            return [self._pool.submit(function, part) for part in parts]


def _begin(ended: connection.Connection, begin: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    threading.Thread(target=_end_with_parent, args=(ended,), daemon=True).start()
    begin(*arguments)


def _end_with_parent(ended: connection.Connection) -> None:
    """A worker whose parent was killed would wait for work for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    connection.wait([parent.sentinel, ended])
    os._exit(1)


class light_main:
    """Keeps spawned workers from importing the parent's main module, which may import torch."""

    def __enter__(self) -> None:
        self._main = sys.modules["__main__"]
        self._kept = {
            name: self._main.__dict__.pop(name) for name in ("__file__",) if hasattr(self._main, name)
        }
        self._spec = getattr(self._main, "__spec__", None)
        self._main.__spec__ = None

    def __exit__(self, *_: object) -> None:
        self._main.__spec__ = self._spec
        self._main.__dict__.update(self._kept)
