"""Spaces of actions that are turned into target joint angles on the policy's side of the simulation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand.kinematics import JOINTS
from tactile_kit.simulation.episode import FULL_RANGE, MIDDLE
from tactile_kit.task.config import TaskConfig

LEAD = 0.5  # rad by which an increment of 1 puts the target ahead of the filtered command


class ActionError(ValueError):
    """An action that no environment can play; the message says what was given and what is allowed."""


def checked(actions: object, shape: tuple[int, ...], finite: bool) -> NDArray:
    """Actions as an array of ``shape``, and with ``finite`` without NaN and infinities. Raises :class:`ActionError`."""
    array = np.asarray(actions)
    if array.dtype.kind not in "fiu" or array.shape != shape:
        raise ActionError(
            f"action of {array.dtype}, shape {array.shape}: allowed are numbers of shape {shape}"
        )
    if finite and not np.isfinite(array).all():
        raise ActionError(f"action {array}: allowed are finite numbers, which are clipped to [-1, 1]")
    return array


def measured(z: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The last joint angles and filtered commands, ``(E, 12)`` rad each, of measurements ``(E, 144)``."""
    last = z.reshape(len(z), -1, 2, JOINTS)[:, -1].astype(np.float64)
    return np.ascontiguousarray(last[:, 0]), last.sum(axis=1)


def absolute(target: NDArray) -> NDArray[np.float32]:
    """The absolute actions that ask for ``target (E, 12)`` rad, or for the end of the joint's range."""
    return np.clip((target - MIDDLE) / FULL_RANGE, -1.0, 1.0).astype(np.float32)


def incremented(actions: NDArray, z: NDArray) -> NDArray[np.float32]:
    """Absolute actions ``(E, 12)`` for steps from the filtered command: 0 rests, 1 moves it on by 0.15 rad in 0.1 s.

    ``actions (E, 12)`` are clipped to [-1, 1]; where one is not finite, so is the answer. ``z (E, 144)`` rad are the
    last measurements.
    """
    _, command = measured(z)
    return absolute(command + LEAD * np.clip(actions, -1.0, 1.0))


def for_simulator(config: TaskConfig, actions: NDArray, z: NDArray) -> NDArray:
    """What the simulator is given for a policy's ``actions (E, 12)`` after the measurements ``z (E, 144)``."""
    return incremented(actions, z) if config.action == "increment" else actions
