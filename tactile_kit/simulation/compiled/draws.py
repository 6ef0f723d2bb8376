"""What the randomisation draws for every control step of every environment's episode, as stacked arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from randomization import Randomization
from tactile_kit.hand.kinematics import JOINTS
from tactile_kit.simulation.config import CONTROL_RATE, SAMPLES


class Draws:
    """Noise, sticky actions and disturbances of the present episodes, ``environments`` of ``horizon`` control steps.

    A term that the preset lacks is zero. The numbers of a seed are those that Bullet's simulator draws.
    """

    def __init__(self, preset: Randomization, environments: int, horizon: int) -> None:
        self._preset, self._horizon = preset, horizon
        self._every = {name: t.interval for name, t in preset.terms.items() if t.interval is not None}
        E = environments
        self._noise = np.zeros((E, horizon, SAMPLES * JOINTS), np.float32)
        self._sticky = np.zeros((E, horizon), bool)
        self._pushes = {
            name: np.zeros((E, _intervals(horizon, every), 3)) for name, every in self._every.items()
        }
        self._all = np.arange(E)

    def begin(self, environment: int, seed: int) -> None:
        """Draw for the episode ``seed`` in ``environment``."""
        steps = self._preset.draw_steps(seed, self._horizon * SAMPLES)
        if "joint_noise" in steps:
            self._noise[environment] = steps["joint_noise"].reshape(self._horizon, -1)
        if "sticky_action" in steps:
            self._sticky[environment] = steps["sticky_action"][: self._horizon]
        for name, rows in self._preset.draw_intervals(seed, self._horizon / CONTROL_RATE).items():
            self._pushes[name][environment] = rows

    def noise(self, elapsed: NDArray[np.int64]) -> NDArray[np.float32]:
        """Of the measured angles in control step ``elapsed (E,)``, ``(E, 72)`` rad."""
        return self._noise[self._all, elapsed]

    def sticky(self, elapsed: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether the last target stays, ``(E,)``."""
        return self._sticky[self._all, elapsed]

    def pushes(self, elapsed: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
        """Present ``force (E, 3)`` N and ``torque (E, 3)`` Nm."""
        # 0.3 / 0.1 is a hair less than 3
        return {
            name: rows[self._all, (elapsed / CONTROL_RATE / self._every[name] + 1e-9).astype(np.int64)]
            for name, rows in self._pushes.items()
        }


def _intervals(horizon: int, every: float) -> int:
    return int(np.ceil(horizon / CONTROL_RATE / every - 1e-9))
