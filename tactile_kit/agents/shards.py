"""A learner's work cut into equal parts, a thread each: one thread's products are never waited for by another's.

Sums over the parts are taken in their order, so the number of parts decides every bit and the scheduler none.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TypeVar

import numpy as np
import torch

Result = TypeVar("Result")


class Shards:
    """``count`` threads with one torch thread each; a single part is worked on by the caller itself."""

    def __init__(self, count: int) -> None:
        if count < 1:
            raise ValueError(f"threads = {count}: allowed are 1 and more")
        self.count = count
        self._pool = _threads(count) if count > 1 else None

    def rows(self, size: int) -> list[slice]:
        """Equal parts of ``size`` rows, empty ones left out."""
        bounds = np.linspace(0, size, self.count + 1).astype(int).tolist()
        return [slice(a, b) for a, b in pairwise(bounds) if a < b]

    def run(self, work: Callable[[slice], Result], size: int) -> list[Result]:
        """What ``work`` makes of each part of ``size`` rows, in their order."""
        parts = self.rows(size)
        if self._pool is None:
            return [work(part) for part in parts]
        return list(self._pool.map(work, parts))


def _threads(count: int) -> ThreadPoolExecutor:
    """A pool whose threads divide no operation of torch any further; the number of the caller's stays as it is."""
    kept, met = torch.get_num_threads(), threading.Barrier(count)

    def begin() -> None:
        torch.set_num_threads(1)
        torch.get_num_threads()  # a thread's first question settles its number, and the next line changes the default

    pool = ThreadPoolExecutor(count, "shard", begin)
    list(pool.map(lambda _: met.wait(), range(count)))  # one task each: all have begun
    torch.set_num_threads(kept)
    return pool
