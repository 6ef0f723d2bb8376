"""What tables and figures say of a set of episode rows: rates, mean angles, changes, each with n and an interval."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

import randomization
from tactile_kit.errors import EvaluationError
from tactile_kit.evaluation.intervals import stratified_bootstrap, wilson
from tactile_kit.evaluation.rows import EpisodeRow

Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True)
class Estimate:
    """A measured number with its 95 % interval and the number of episodes behind it.

    ``low`` and ``high`` are None where the data hold no information on the spread.
    """

    value: float
    low: float | None
    high: float | None
    n: int
    successes: int | None = None


def success_rate(rows: Sequence[EpisodeRow]) -> Estimate:
    """Fraction of successes with Wilson's interval. Drops and faults count as failures (paper, Sec. III-C)."""
    if not rows:
        raise EvaluationError("success rate of no episodes; at least one row is needed")
    return share(sum(row.success for row in rows), len(rows))


def share(count: int, total: int) -> Estimate:
    """``count`` of ``total`` episodes, with Wilson's interval."""
    low, high = wilson(count, total)
    return Estimate(count / total, low, high, total, count)


def final_angles(rows: Iterable[EpisodeRow]) -> np.ndarray:
    """(N,) float64, rad: the final angles of the episodes that have one (all but simulation faults)."""
    return np.array([row.theta for row in rows if row.theta is not None], dtype=np.float64)


def group(rows: Iterable[EpisodeRow], key: Callable[[EpisodeRow], Key]) -> dict[Key, list[EpisodeRow]]:
    """Rows by key, keys in order of appearance."""
    groups: dict[Key, list[EpisodeRow]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return groups


def mean_final_angle(rows: Sequence[EpisodeRow], seed: int = 0) -> Estimate:
    """Mean final angle (rad) over episodes, bootstrap interval stratified by object."""
    strata = _angles_by_object(rows)
    n = sum(map(len, strata))
    low, high = _bootstrap(strata, lambda s: np.concatenate(s).mean(), seed, "mean_final_angle")
    return Estimate(float(np.concatenate(strata).mean()), low, high, n)


def relative_change(
    rows: Sequence[EpisodeRow], base: Sequence[EpisodeRow], quantity: str, seed: int = 0
) -> Estimate | None:
    """(quantity of rows - quantity of base) / quantity of base, as in the paper's Table II.

    Args:
        quantity: ``"success"`` or ``"angle"``, the mean over episodes.

    Returns:
        The change as a fraction (-0.3 is -30 %) with a bootstrap interval, episodes resampled within each object of
        each agent; n counts the episodes of ``rows``. None where the base is zero, so that no ratio exists.
    """
    if quantity not in ("success", "angle"):
        raise EvaluationError(f"quantity = {quantity!r}; allowed are 'success' and 'angle'")
    strata_of = _angles_by_object if quantity == "angle" else _successes_by_object
    ours, theirs = strata_of(rows), strata_of(base)
    split = len(ours)

    def change(strata: list[np.ndarray]) -> float:
        reference = np.concatenate(strata[split:]).mean()
        value = np.concatenate(strata[:split]).mean()
        return value / reference - 1.0 if reference > 0 else np.nan

    value = change([*ours, *theirs])
    if np.isnan(value):
        return None
    low, high = _bootstrap([*ours, *theirs], change, seed, "relative_change")
    return Estimate(float(value), low, high, sum(map(len, ours)))


def _angles_by_object(rows: Sequence[EpisodeRow]) -> list[np.ndarray]:
    groups = group((row for row in rows if row.theta is not None), lambda row: row.object_id)
    if not groups:
        raise EvaluationError("final angle of no episodes; at least one row without a fault is needed")
    return [final_angles(groups[key]) for key in sorted(groups)]


def _successes_by_object(rows: Sequence[EpisodeRow]) -> list[np.ndarray]:
    groups = group(rows, lambda row: row.object_id)
    if not groups:
        raise EvaluationError("success rate of no episodes; at least one row is needed")
    return [np.array([row.success for row in groups[key]], dtype=np.float64) for key in sorted(groups)]


def _bootstrap(
    strata: list[np.ndarray], statistic: Callable, seed: int, purpose: str
) -> tuple[float | None, float | None]:
    if max(map(len, strata)) < 2:
        return None, None
    low, high = stratified_bootstrap(
        strata, statistic, generator=randomization.stream(seed, "bootstrap", purpose)
    )
    # A replicate without one base success has no ratio; then the data bound the change on no side.
    return (None, None) if np.isnan(low) or np.isnan(high) else (float(low), float(high))
