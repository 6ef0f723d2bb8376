"""What is drawn for every control step of every environment's episode, as stacked arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from randomization import Randomization
from tactile_kit.hand.kinematics import JOINTS
from tactile_kit.simulation.config import CONTROL_RATE, SAMPLES
from tactile_kit.simulation.episode import Episode, intervals


class Draws:
    """Noise, sticky actions and disturbances of the present episodes, ``environments`` of ``horizon`` control steps.

    A term that the preset lacks is zero.
    """

    def __init__(self, preset: Randomization, environments: int, horizon: int) -> None:
        self._every, E = intervals(preset), environments
        self._noise = np.zeros((E, horizon, SAMPLES * JOINTS), np.float32)
        self._sticky = np.zeros((E, horizon), bool)
        self._pushes = {
            name: np.zeros((E, int(np.ceil(horizon / CONTROL_RATE / every - 1e-9)), 3))
            for name, every in self._every.items()
        }
        self._all = np.arange(E)

    def begin(self, environment: int, episode: Episode) -> None:
        """Take over what was drawn for ``episode`` in ``environment``."""
        if episode.noise is not None:
            self._noise[environment] = episode.noise.reshape(len(episode.noise), -1)
        if episode.sticky is not None:
            self._sticky[environment] = episode.sticky
        for name, rows in episode.pushes.items():
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
