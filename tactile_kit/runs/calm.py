"""Less noise whenever success has levelled off, and after the last time an end."""

from __future__ import annotations

from typing import Any

from pydantic import Field, PositiveInt, model_validator

from tactile_kit.settings import Settings


class CalmConfig(Settings):
    """Levels of noise, each kept until the exploring policy's success no longer rises.

    What levels off is success under the policy's own noise and, of tactile agents, under that of the estimator's
    weights; with less of both the same agents rose again at once (docs/training-on-cpu.md). Success is compared between
    one span of ``patience`` steps and the next, at full gravity and while policy and estimator both learn on what is
    evaluated later: no lessons, no truth told.
    """

    log_std: tuple[float, ...] = Field(
        (-1.4, -2.0, -2.2), description="Ceiling of log sigma at each level; empty: none, and no early end."
    )
    slowing: float = Field(
        0.3, gt=0, le=1, description="Factor of the estimator's step size from one level to the next."
    )
    patience: PositiveInt = Field(5_000_000, description="Environment steps of a span.")
    gain: float = Field(0.005, ge=0, le=1, description="Least rise of success from one span to the next.")
    floor: float = Field(
        0.1, ge=0, le=1, description="Success below which no level is left: learning has not begun."
    )

    @model_validator(mode="after")
    def _falls(self) -> CalmConfig:
        if any(later > earlier for earlier, later in zip(self.log_std, self.log_std[1:], strict=False)):
            raise ValueError(f"log_std {list(self.log_std)}: allowed are numbers that never rise")
        return self


class Calm:
    """Where a run stands among the levels.

    Attributes:
        level: index into ``config.log_std``.
        over: whether success has levelled off at the last one.
    """

    def __init__(self, config: CalmConfig) -> None:
        self.config, self.level, self.over = config, 0, False
        self._before: float | None = None  # success in the last whole span
        self._start: tuple[int, int, int] | None = None  # steps, episodes and successes when this span began

    @property
    def log_std(self) -> float | None:
        """Ceiling of log sigma by now; None: none."""
        return self.config.log_std[self.level] if self.config.log_std else None

    @property
    def slowed(self) -> float:
        """What the estimator's step size is multiplied by."""
        return float(self.config.slowing**self.level)

    def look(self, settled: bool, steps: int, episodes: int, successes: int) -> None:
        """Take note of ``episodes`` finished after ``steps`` so far; not ``settled``: nothing of it counts yet."""
        if not settled or self.over or not self.config.log_std:
            self._before = self._start = None
            return
        if self._start is None:
            self._start = (steps, episodes, successes)
        begun, told, reached = self._start
        if steps - begun < self.config.patience or episodes == told:
            return
        now = (successes - reached) / (episodes - told)
        rises = self._before is None or now >= self._before + self.config.gain
        level = not rises and now >= self.config.floor
        self._before, self._start = now, (steps, episodes, successes)
        if level:
            self._before = None
            self.over = self.level + 1 == len(self.config.log_std)
            self.level += not self.over

    def state(self) -> dict[str, Any]:
        """JSON values for a checkpoint."""
        return {"level": self.level, "over": self.over, "before": self._before, "start": self._start}

    def restore(self, state: dict[str, Any]) -> None:
        """Inverse of :meth:`state`."""
        self.level, self.over, self._before = state["level"], state["over"], state["before"]
        self._start = tuple(state["start"]) if state["start"] else None
