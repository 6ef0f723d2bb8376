"""What an episode is, whichever engine plays it: what is drawn for it, what actions mean, and how it ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

import randomization
from randomization import Randomization
from tactile_kit.hand import kinematics
from tactile_kit.simulation.config import CONTROL_RATE, SAMPLES

Array = NDArray[np.float64]

LOWEST = -0.05  # m: below, the object is dropped
WIDEST = 0.10  # m: |x| beyond, the object is dropped
FULL_RANGE = 0.5 * (kinematics.JOINT_UPPER - kinematics.JOINT_LOWER)
MIDDLE = 0.5 * (kinematics.JOINT_UPPER + kinematics.JOINT_LOWER)
# Twice what the wildest actions bring about (2.2 m/s and 35 rad/s), and more than they push a finger in (18 mm).
MAX_SPEED, MAX_SPIN = 5.0, 70.0  # of the object, m/s and rad/s
MAX_DEPTH = 0.025  # m of a finger inside the object


class EpisodeError(ValueError):
    """A randomisation draws something that an engine leaves out."""


class Status(IntEnum):
    """How a control step ended."""

    RUNNING = 0
    TIME = 1  # the horizon is reached
    DROP = 2
    FAULT = 3  # the physics left its range


def dropped(position: NDArray) -> NDArray | bool:
    """Whether an object at ``position (..., 3)`` m counts as dropped."""
    return (position[..., 2] < LOWEST) | (np.abs(position[..., 0]) > WIDEST)


class Physics(TypedDict):
    """What is drawn once an episode; meanings and units in docs/randomization.md."""

    joint_offset: Array  # (12,)
    kp: float
    kd: float
    series_stiffness: float
    stick_friction: Array  # (12,)
    tip_friction: float
    link_friction: float
    spinning_friction: float
    object_mass_offset: float
    gravity: float


LATER = {"joint_noise", "sticky_action", "force", "torque"}  # what is drawn for steps and intervals


@dataclass(frozen=True)
class Episode:
    """All that is random in an episode, from its seed.

    Attributes:
        physics: from its start to its end.
        grasp: number of the initial grasp, among the variant's.
        noise: of the measured angles, ``(horizon, 6, 12)`` rad, or None.
        sticky: control steps in which the last target stays, ``(horizon,) bool``, or None.
        pushes: ``force`` (N) and ``torque`` (Nm) on the object by name, ``(intervals, 3)``.
        every: seconds of an interval, by name.
    """

    physics: Physics
    grasp: int
    noise: Array | None
    sticky: NDArray[np.bool_] | None
    pushes: Mapping[str, Array]
    every: Mapping[str, float]

    @classmethod
    def drawn(cls, preset: Randomization, seed: int, gravity: float, horizon: int, grasps: int) -> Episode:
        """The episode of ``seed`` and so many control steps, under ``gravity`` (m/s^2), from one of ``grasps``.

        Raises EpisodeError where the preset has a term that no engine knows.
        """
        physics: Any = {**preset.draw("episode", seed), "gravity": gravity}
        steps = preset.draw_steps(seed, horizon * SAMPLES)
        pushes = preset.draw_intervals(seed, horizon / CONTROL_RATE)
        unknown = (physics.keys() - Physics.__annotations__.keys()) | ((steps.keys() | pushes.keys()) - LATER)
        if unknown:
            raise EpisodeError(f"no engine plays what {preset.name!r} draws: {', '.join(sorted(unknown))}")
        noise, sticky = steps.get("joint_noise"), steps.get("sticky_action")
        return cls(
            physics,
            int(randomization.stream(seed, "grasp").integers(grasps)),
            None if noise is None else noise.reshape(horizon, SAMPLES, kinematics.JOINTS),
            None if sticky is None else sticky[:horizon].astype(bool),
            pushes,
            intervals(preset),
        )

    def pushed(self, number: int) -> dict[str, int]:
        """The row of each of ``pushes`` that holds in control step ``number``."""
        # 0.3 / 0.1 is a hair less than 3
        return {name: int(number / CONTROL_RATE / self.every[name] + 1e-9) for name in self.pushes}


def intervals(preset: Randomization) -> dict[str, float]:
    """Seconds between draws of the terms that are drawn now and then."""
    return {name: term.interval for name, term in preset.terms.items() if term.interval is not None}


class _Watched(dict):
    """A drawn physics that knows which of its terms were read."""

    def __init__(self, physics: Mapping[str, Any]) -> None:
        super().__init__(physics)
        self.read: set[str] = set()

    def __getitem__(self, name: str) -> Any:
        self.read.add(name)
        return super().__getitem__(name)


def heed(engine: str, physics: Mapping[str, Any], take: Callable[[Any], None]) -> None:
    """Let an engine ``take`` the physics; raises EpisodeError naming the terms that it did not look at."""
    watched = _Watched(physics)
    take(watched)
    if ignored := sorted(physics.keys() - watched.read):
        raise EpisodeError(f"engine {engine!r} ignores what is drawn: {', '.join(ignored)}")
