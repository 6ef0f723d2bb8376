"""Courses as artefacts read them: whole episodes, by condition, and what is averaged over them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import randomization
from tactile_kit.evaluation.courses import MOMENTS, Moment
from tactile_kit.evaluation.intervals import CONFIDENCE, stratified_bootstrap
from tactile_kit.evaluation.rows import SUCCESS_ANGLE
from tactile_kit.evaluation.summary import Estimate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Track:
    """One episode under one condition, in order of time."""

    moments: tuple[Moment, ...]

    @property
    def last(self) -> Moment:
        """How it ended."""
        return self.moments[-1]

    @property
    def object_id(self) -> int:
        return self.last.object_id

    @property
    def start(self) -> float:
        """Angle to the goal at the start, rad; NaN where nobody wrote it down."""
        return self.moments[0].theta if self.moments[0].time == 0 else math.nan

    @property
    def arrived(self) -> float:
        """s until it was first within 0.4 rad of the goal; infinite where it never was. The drop itself is none."""
        times = (m.time for m in self.moments if m.theta < SUCCESS_ANGLE and m.end in ("", "time"))
        return next(times, math.inf)

    def values(self, name: str) -> list[float]:
        """Of a column at ``MOMENTS``, NaN once the episode is over. The moment of a drop counts for nothing."""
        held = {m.time: getattr(m, name) for m in self.moments if m.end in ("", "time")}
        return [float(held.get(time, math.nan)) for time in MOMENTS]


def tracks(lines: Sequence[Moment]) -> dict[str, list[Track]]:
    """Episodes by condition, in order of the lines."""
    found: dict[str, list[Track]] = {}
    course: list[Moment] = []
    for line in lines:
        course.append(line)
        if line.end:
            found.setdefault(line.condition, []).append(Track(tuple(course)))
            course = []
    return found


def means(
    parts: Sequence[Track], values: Callable[[Track], Sequence[float]], seed: int
) -> list[Estimate | None]:
    """Mean over episodes of each of K values an episode has, NaN left out; None where no episode has one.

    Intervals by bootstrap within objects; none where no object has two episodes.
    """
    if not parts:
        return []
    strata = _strata(parts, values)
    everything = np.concatenate(strata)
    counts = np.isfinite(everything).sum(axis=0)
    low = high = np.full(everything.shape[1], np.nan)
    if max(map(len, strata)) > 1:
        low, high = stratified_bootstrap(
            strata,
            lambda s: _mean(np.concatenate(s)),
            generator=randomization.stream(seed, "bootstrap", "courses"),
        )
    return [
        Estimate(float(value), _known(a), _known(b), int(n)) if n else None
        for value, a, b, n in zip(_mean(everything), low, high, counts, strict=True)
    ]


def quotient(
    parts: Sequence[Track], terms: Callable[[Track], tuple[float, float]], seed: int
) -> Estimate | None:
    """Square root of the quotient of two sums over episodes, interval by bootstrap within objects; None of nothing.

    ``n`` counts episodes whose second term is not zero.
    """
    strata = _strata(parts, terms) if parts else []
    if not strata or not np.concatenate(strata)[:, 1].any():
        return None

    def root(strata: list[Array]) -> float:
        first, second = np.concatenate(strata).sum(axis=0)
        return math.sqrt(first / second) if second else math.nan

    low, high = None, None
    if max(map(len, strata)) > 1:
        ends = stratified_bootstrap(
            strata, root, generator=randomization.stream(seed, "bootstrap", "calibration")
        )
        low, high = (_known(float(end)) for end in ends)
    return Estimate(root(strata), low, high, int((np.concatenate(strata)[:, 1] > 0).sum()))


def median(values: Sequence[float]) -> Estimate | None:
    """Median of numbers of which some may be infinite, with the interval that order statistics give; None where the
    median itself is infinite. The interval is left out where its upper end is, and of fewer than six numbers."""
    from scipy.stats import binom

    ordered = sorted(values)
    n = len(ordered)
    middle = float(np.median(ordered)) if n else math.inf
    if not math.isfinite(middle):
        return None
    tail = (1.0 - CONFIDENCE) / 2
    rank = int(
        binom.ppf(tail, n, 0.5)
    )  # of the lower end, counted from 1; the upper one is as far from the other end
    if rank == 0 or not math.isfinite(ordered[n - rank]):
        return Estimate(middle, None, None, n)
    return Estimate(middle, ordered[rank - 1], ordered[n - rank], n)


def _strata(parts: Sequence[Track], values: Callable[[Track], Sequence[float]]) -> list[Array]:
    by_object: dict[int, list[Sequence[float]]] = {}
    for track in parts:
        by_object.setdefault(track.object_id, []).append(values(track))
    return [np.array(rows, np.float64) for _, rows in sorted(by_object.items())]


def _mean(rows: Array) -> Array:
    """(N, K) to (K,): of what is there, NaN where nothing is."""
    there = np.isfinite(rows)
    counts = there.sum(axis=0)
    sums = np.where(there, rows, 0.0).sum(axis=0)
    return np.divide(sums, counts, out=np.full(rows.shape[1], np.nan), where=counts > 0)


def _known(value: float) -> float | None:
    return None if math.isnan(value) else float(value)
