"""How estimates and beliefs fare while both are trained: sums since they were last asked for."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactile_kit.rotations import geodesic

Array = NDArray[np.floating]


@dataclass
class Watch:
    """Figures of the episodes in which the policy is told the estimate; none where there were no such steps or ends.

    ``fed/off``: error of the estimated angle over all steps, rad, and ``fed/off_told`` the same where the policy is
    told the truth; ``fed/turn``: what an object turns a step, rad. Of ended episodes: ``fed/success``, ``fed/drops``,
    and of those not dropped ``fed/theta``, ``fed/believed`` (true and believed angle to the goal) and
    ``fed/off_end``, rad.
    """

    steps: dict[str, list[float]] = field(default_factory=dict)  # name: sum, count
    ends: list[tuple[float, float, float, float]] = field(default_factory=list)

    def step(self, estimate: Array, R: Array, R_before: Array, told: NDArray[np.bool_]) -> None:
        """One step of all environments: rotations ``(E, 3, 3)``; ``told (E,)``, whether the policy knows the truth."""
        off, turn = geodesic(estimate, R), geodesic(R, R_before)
        for name, values in (("off", off[~told]), ("off_told", off[told]), ("turn", turn[~told])):
            total = self.steps.setdefault(name, [0.0, 0.0])
            total[0] += float(values.sum())
            total[1] += len(values)

    def end(self, success: bool, drop: bool, theta: float, believed: float, off: float) -> None:
        """An episode in which the policy was told the estimate."""
        held = np.nan if drop else 1.0
        self.ends.append((success, drop, held * theta, held * believed, held * off))  # type: ignore[arg-type]

    def take(self) -> dict[str, float]:
        """The figures since the last call."""
        found = {f"fed/{name}": total / count for name, (total, count) in self.steps.items() if count}
        if self.ends:
            rows = np.array(self.ends, dtype=np.float64)
            for name, column in zip(
                ("success", "drops", "theta", "believed", "off_end"), rows.T, strict=True
            ):
                values = column[np.isfinite(column)]
                if len(values):
                    found[f"fed/{name}"] = float(values.mean())
        self.steps, self.ends = {}, []
        return found
