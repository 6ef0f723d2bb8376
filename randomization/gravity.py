"""The gravity curriculum: learning starts in light gravity, where a slip is no drop yet, and ends in full."""

from __future__ import annotations

import math
from dataclasses import dataclass

from randomization.errors import RandomizationError

STANDARD_GRAVITY = 9.81  # m/s^2
MAXIMUM = 20.0  # m/s^2; more than twice the earth's is a slip of the unit


@dataclass(frozen=True)
class GravitySchedule:
    """Magnitude of gravity against environment steps: a straight line, then constant.

    The sister papers of the same lab start at a tenth of the earth's gravity.

    Attributes:
        geometric: by equal factors instead of equal steps.
        start: at step 0, m/s^2.
        end: from ``steps`` on, m/s^2.
        steps: environment steps (summed over all environments) the line takes; 0: ``end`` from the start.
    """

    start: float = 0.1 * STANDARD_GRAVITY
    end: float = STANDARD_GRAVITY
    steps: int = 0
    geometric: bool = False

    def __post_init__(self) -> None:
        for name in ("start", "end"):
            value = getattr(self, name)
            if not (math.isfinite(value) and 0 <= value <= MAXIMUM):
                raise RandomizationError(f"gravity {name} = {value}: allowed are 0 to {MAXIMUM:g} m/s^2")
        if self.geometric and 0 in (self.start, self.end):
            raise RandomizationError(
                "gravity start or end = 0: allowed are more than 0 m/s^2 for equal factors"
            )
        if self.steps < 0:
            raise RandomizationError(f"gravity steps = {self.steps}: allowed are integers >= 0")

    def at(self, step: int) -> float:
        """Magnitude of gravity (m/s^2) after ``step`` environment steps; ``step`` >= 0."""
        if step < 0:
            raise RandomizationError(f"step = {step}: allowed are integers >= 0")
        if step >= self.steps:
            return self.end
        if self.geometric:
            return float(self.start * (self.end / self.start) ** (step / self.steps))
        return self.start + (self.end - self.start) * step / self.steps
