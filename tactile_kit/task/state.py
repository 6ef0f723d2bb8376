"""What the batched environment shows of itself: where it stands, its last step, how an episode ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_kit.task.goals import EpisodeSpec

Array = NDArray[Any]


@dataclass
class State:
    """Where every environment stands now, first axis environments.

    ``z (E, 144)``, ``x, x0 (E, 3)``, ``R, R0, goal (E, 3, 3)``, ``given, variant, elapsed (E,)``.
    """

    z: Array
    x: Array
    R: Array
    x0: Array
    R0: Array
    goal: Array
    given: Array
    variant: Array
    elapsed: Array

    @classmethod
    def blank(cls, count: int) -> State:
        """Before the first episode of ``count`` environments."""
        eye = np.tile(np.eye(3), (count, 1, 1))
        x, x0 = np.zeros((count, 3)), np.zeros((count, 3))
        numbers = [np.zeros(count, np.int64) for _ in range(3)]
        return cls(np.zeros((count, 144), np.float32), x, eye, x0, eye.copy(), eye.copy(), *numbers)


@dataclass
class Transition:
    """Where the last step led before any new episode began: ``R, goal (E, 3, 3)``, ``x (E, 3)``.

    ``reward_terms``, each ``(E,)``, by name.
    """

    R: Array
    x: Array
    goal: Array
    reward_terms: dict[str, Array]


@dataclass
class EpisodeResult:
    """How one episode ended."""

    spec: EpisodeSpec
    theta: float  # final angle to the goal, rad
    theta_min: float
    success: bool
    drop: bool
    fault: str | None
    steps: int
    reward: float
