"""Confidence intervals: Wilson's for success counts, the stratified bootstrap for everything averaged."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from tactile_kit.errors import EvaluationError

CONFIDENCE = 0.95


class Interval(NamedTuple):
    """Lower and upper end, both included."""

    low: float
    high: float


def _quantile(confidence: float) -> float:
    if not 0.0 < confidence < 1.0:
        raise EvaluationError(f"confidence = {confidence!r}; allowed are numbers in (0, 1)")
    return NormalDist().inv_cdf(0.5 + confidence / 2)


def wilson(successes: int, episodes: int, confidence: float = CONFIDENCE) -> Interval:
    """Wilson's score interval of a success probability.

    Unlike the normal approximation it stays within [0, 1] and has a width at 0 and at ``episodes`` successes.
    (E. B. Wilson, "Probable inference, the law of succession, and statistical inference", JASA 1927.)
    """
    if episodes < 1 or not 0 <= successes <= episodes:
        raise EvaluationError(
            f"{successes} successes of {episodes}; allowed are 0 <= successes <= episodes >= 1"
        )
    z = _quantile(confidence)
    rate, z2 = successes / episodes, z * z
    centre = (rate + z2 / (2 * episodes)) / (1 + z2 / episodes)
    half = z / (1 + z2 / episodes) * math.sqrt(rate * (1 - rate) / episodes + z2 / (4 * episodes * episodes))
    # At the ends the formula gives 0 and 1 exactly; rounding would leave 1e-17.
    return Interval(0.0 if successes == 0 else centre - half, 1.0 if successes == episodes else centre + half)


def difference(
    successes: int, episodes: int, other_successes: int, other_episodes: int, confidence: float = CONFIDENCE
) -> Interval:
    """Newcombe's interval (his method 10, from two Wilson intervals) of rate - other rate, independent samples."""
    first = wilson(successes, episodes, confidence)
    second = wilson(other_successes, other_episodes, confidence)
    rate, other = successes / episodes, other_successes / other_episodes
    low = rate - other - math.hypot(rate - first.low, second.high - other)
    high = rate - other + math.hypot(first.high - rate, other - second.low)
    return Interval(low, high)


def stratified_bootstrap(
    strata: Sequence[np.ndarray],
    statistic: Callable[[list[np.ndarray]], np.ndarray | float],
    *,
    generator: np.random.Generator,
    replicates: int = 1000,
    confidence: float = CONFIDENCE,
) -> tuple[np.ndarray, np.ndarray]:
    """Percentile bootstrap that resamples within each stratum, with replacement.

    Args:
        strata: arrays (n_i, ...) float; the first axis holds the independent units: the seeds of a curve, the episodes
            of an object. A stratum keeps its size in every replicate.
        statistic: maps the list of (resampled) strata to a number or an array.
        generator: where the resampling takes its numbers from.

    Returns:
        (low, high), float64 arrays of the statistic's shape.

    Raises:
        EvaluationError: no stratum, an empty one, or only strata of one unit, which say nothing about the spread.
    """
    strata = [np.asarray(stratum, dtype=np.float64) for stratum in strata]
    if not strata or any(len(stratum) == 0 for stratum in strata):
        raise EvaluationError(
            f"strata of sizes {[len(s) for s in strata]}; allowed are one or more, none empty"
        )
    if max(len(stratum) for stratum in strata) < 2:
        raise EvaluationError(
            "every stratum holds one unit; at least one must hold two or more for an interval"
        )
    tail = (1.0 - confidence) / 2
    _quantile(confidence)
    values = [
        statistic([stratum[generator.integers(len(stratum), size=len(stratum))] for stratum in strata])
        for _ in range(replicates)
    ]
    low, high = np.quantile(np.asarray(values, dtype=np.float64), [tail, 1.0 - tail], axis=0)
    return low, high
