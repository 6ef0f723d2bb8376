"""Spaces of actions that are turned into target joint angles on the policy's side of the simulation."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand.kinematics import JOINTS
from tactile_kit.simulation.simulator import FULL_RANGE, MIDDLE
from tactile_kit.task.config import TaskConfig

LEAD = 0.5  # rad by which an action of 1 puts the target ahead of the filtered command


class Actions(Protocol):
    """What turns a policy's actions into absolute ones."""

    def begin(self, which: NDArray[np.bool_]) -> None:
        """New episodes in the environments of ``which (E,)``."""

    def __call__(
        self, actions: NDArray, z: NDArray, x: NDArray, R: NDArray, goal: NDArray
    ) -> NDArray[np.float32]:
        """Absolute actions ``(E, 12) float32`` in [-1, 1].

        Args:
            actions: the policy's, ``(E, 12)``, clipped to [-1, 1]; where one is not finite, so is the answer.
            z: measurements ``(E, 144)`` rad: joint angles, and by how much they lag behind the command.
            x, R: pose of the object as far as the policy is told, ``(E, 3)`` m, ``(E, 3, 3)``.
            goal: orientations ``(E, 3, 3)``.
        """


def measured(z: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The last joint angles and filtered commands, ``(E, 12)`` rad each, of measurements ``(E, 144)``."""
    last = z.reshape(len(z), -1, 2, JOINTS)[:, -1].astype(np.float64)
    return np.ascontiguousarray(last[:, 0]), last.sum(axis=1)


def absolute(target: NDArray) -> NDArray[np.float32]:
    """The absolute actions that ask for ``target (E, 12)`` rad, or for the end of the joint's range."""
    return np.clip((target - MIDDLE) / FULL_RANGE, -1.0, 1.0).astype(np.float32)


class Increments:
    """Actions relative to the filtered command: 0 rests, 1 moves the command on by 0.15 rad in a control step."""

    def begin(self, which: NDArray[np.bool_]) -> None:
        """Nothing is kept from one action to the next."""

    def __call__(
        self, actions: NDArray, z: NDArray, x: NDArray, R: NDArray, goal: NDArray
    ) -> NDArray[np.float32]:
        """See :class:`Actions`."""
        _, command = measured(z)
        return absolute(command + LEAD * np.clip(actions, -1.0, 1.0))


def actions_of(config: TaskConfig, count: int) -> Actions | None:
    """What the task's actions need for ``count`` environments; None: they are absolute, or the simulator's matter."""
    if config.action == "increment":
        return Increments()
    if config.action == "gait":
        from tactile_kit.planning.actions import GaitActions

        return GaitActions(count, config.simulation.filter_time_constant)
    return None
