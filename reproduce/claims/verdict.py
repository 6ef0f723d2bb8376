"""What a claim's test says, and the rules all tests share.

* A comparison counts only where its 95 % interval excludes the other answer, and where the effect is as large as the
  claim's words: "clearly" is ``CLEAR``, "quickly" and "by 10 %" are ``MANY``.
* An effect that is large enough, of which the interval does not exclude the other answer, is not measured.
* A comparison of learning curves needs two seeds a line or more: one seed says nothing about the next.
* A comparison of agents of which the stronger one hardly ever succeeds says nothing: it is not measured.
* Nor does a comparison of agents of which one was trained much longer than the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from reproduce.cells import percent
from reproduce.results import Results
from tactile_kit.evaluation.intervals import difference, wilson
from tactile_kit.evaluation.rows import EpisodeRow

REPRODUCED, NOT_REPRODUCED, NOT_MEASURED = "reproduced", "not reproduced", "not measured"

LEARNED = (
    0.10  # a rate whose lower bound lies below this is too near to chance (0.3 %) and luck to compare with
)
CLEAR = 0.05  # differences of success rates smaller than this are "no clear difference" in the paper's sense
MANY = 0.10  # "over 10 % better", "falls quickly"


@dataclass(frozen=True)
class Verdict:
    """``figures``: the numbers behind it, in words. ``n``: episodes, or seeds for learning curves."""

    verdict: str
    figures: str
    n: int = 0
    unit: str = "episodes"


class NotMeasured(Exception):
    """Raised inside a test where data are missing or too thin; the text says which."""

    def __init__(self, why: str, n: int = 0, unit: str = "episodes") -> None:
        super().__init__(why)
        self.n, self.unit = n, unit


Test = Callable[[Results], Verdict]


def needed(results: Results, role: str, evaluation: str) -> list[EpisodeRow]:
    """The rows of a role, or ``NotMeasured``."""
    rows = results.rows(role, evaluation)
    if rows is None:
        raise NotMeasured(f"missing: {role}, {evaluation}")
    return rows


@dataclass(frozen=True)
class Count:
    """Successes of episodes."""

    successes: int
    episodes: int

    @property
    def rate(self) -> float:
        return self.successes / self.episodes

    def __str__(self) -> str:
        low, high = wilson(self.successes, self.episodes)
        return f"{percent(self.rate, 1)} [{percent(low, 1)}, {percent(high, 1)}]"


def count(rows: Sequence[EpisodeRow], what: str) -> Count:
    """Counts successes; no episodes at all is ``NotMeasured``."""
    if not rows:
        raise NotMeasured(f"missing: no episodes of {what}")
    return Count(sum(row.success for row in rows), len(rows))


def minus(first: Count, second: Count) -> tuple[float, float, float]:
    """(difference of rates, low, high), Newcombe's 95 % interval."""
    low, high = difference(first.successes, first.episodes, second.successes, second.episodes)
    return first.rate - second.rate, low, high


def further(
    first: tuple[float, float, float], second: tuple[float, float, float]
) -> tuple[float, float, float]:
    """(difference of two independent differences, low, high); each is (value, low, high) itself."""
    value = first[0] - second[0]
    low = value - math.hypot(first[0] - first[1], second[2] - second[0])
    high = value + math.hypot(first[2] - first[0], second[0] - second[1])
    return value, low, high


def signed(value: float, low: float, high: float) -> str:
    """'+3.0 % [-1.0 %, +7.0 %]'."""
    return f"{100 * value:+.1f} % [{100 * low:+.1f} %, {100 * high:+.1f} %]"


def must_have_learned(counts: dict[str, Count]) -> None:
    """``NotMeasured`` unless at least one of these agents clearly does better than chance and luck."""
    if not any(wilson(c.successes, c.episodes).low > LEARNED for c in counts.values()):
        shown = ", ".join(f"{name} {c}" for name, c in counts.items())
        raise NotMeasured(
            f"the agents turn too few objects to their goals yet for this comparison to mean anything: {shown}",
            sum(c.episodes for c in counts.values()),
        )


def must_be_trained_alike(results: Results, roles: Sequence[str]) -> None:
    """``NotMeasured`` where one of these agents was trained for many more steps than another."""
    if why := results.unlike(roles):
        raise NotMeasured(why)
