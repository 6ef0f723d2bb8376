"""What was played, as it is shown: frames of an episode. Knows neither physics nor browser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from object_sets import Object
from tactile_kit.evaluation.schedule import Outcome
from tactile_kit.rotations import geodesic

Array = NDArray[np.float64]
STEP = 0.1  # s from frame to frame, one control step


@dataclass(frozen=True)
class Pose:
    """``position (3,)`` m and ``rotation (3, 3)``, world frame."""

    position: Array
    rotation: Array

    def towards(self, other: Pose, share: float) -> Pose:
        """Between this (share 0) and the other (1), along the shortest turn."""
        turn = Rotation.from_matrix(self.rotation.T @ other.rotation).as_rotvec()
        rotation = self.rotation @ Rotation.from_rotvec(share * turn).as_matrix()
        return Pose(self.position + share * (other.position - self.position), rotation)


@dataclass(frozen=True)
class Contacts:
    """Where fingers touch the object: ``points (N, 3)`` m, world frame, and normal ``forces (N,)`` N."""

    points: Array
    forces: Array


NO_CONTACTS = Contacts(np.empty((0, 3)), np.empty(0))


@dataclass(frozen=True)
class Frame:
    """One moment.

    Attributes:
        time: s since the start.
        joints: driven angles ``(12,)`` rad.
        truth: pose of the object held.
        estimate: believed pose; None where the agent is told the truth.
        sigma: predicted uncertainties, m and rad, ``(2,)``; None without an estimate.
        contacts: with the fingers.
        pushed: whether somebody pushed the object in the step before.
    """

    time: float
    joints: Array
    truth: Pose
    estimate: Pose | None = None
    sigma: Array | None = None
    contacts: Contacts = NO_CONTACTS
    pushed: bool = False

    @property
    def belief(self) -> Pose:
        """The pose that the policy was told."""
        return self.truth if self.estimate is None else self.estimate

    def towards(self, other: Frame, share: float) -> Frame:
        """A picture between two frames, for the eye only; contacts are those of the earlier one."""
        if share <= 0:
            return self
        estimate = self.estimate
        if estimate is not None and other.estimate is not None:
            estimate = estimate.towards(other.estimate, share)
        return replace(
            self,
            time=self.time + share * (other.time - self.time),
            joints=self.joints + share * (other.joints - self.joints),
            truth=self.truth.towards(other.truth, share),
            estimate=estimate,
        )


@dataclass
class Clip:
    """An episode as far as it was played.

    Attributes:
        agent: its name, for captions.
        held, given: the object held, and the one whose mesh the agent is told.
        goal: orientation ``(3, 3)``.
        success_angle: rad.
        frames: from the start on, one a control step.
        outcome: how it ended; None while it has not.
    """

    agent: str
    held: Object
    given: Object
    goal: Array
    success_angle: float
    frames: list[Frame] = field(default_factory=list)
    outcome: Outcome | None = None

    @property
    def times(self) -> Array:
        """``(N,)`` s."""
        return np.array([frame.time for frame in self.frames])

    @property
    def angles(self) -> Array:
        """Angle from the object to the goal, ``(N,)`` rad."""
        return self._angles([frame.truth.rotation for frame in self.frames], self.goal)

    @property
    def errors(self) -> Array | None:
        """Angle from the estimate to the truth, ``(N,)`` rad; None without an estimate."""
        estimates = [frame.estimate.rotation for frame in self.frames if frame.estimate is not None]
        if not estimates or len(estimates) < len(self.frames):
            return None
        return self._angles(estimates, np.stack([frame.truth.rotation for frame in self.frames]))

    def at(self, place: float) -> Frame:
        """The frame at ``place``, counted in frames from 0, also between two; beyond the ends those at the ends."""
        place = float(np.clip(place, 0, len(self.frames) - 1))
        number = int(place)
        later = self.frames[min(number + 1, len(self.frames) - 1)]
        return self.frames[number].towards(later, place - number)

    def verdict(self) -> str:
        """How it ended, in words; empty while it has not."""
        if self.outcome is None:
            return ""
        if self.outcome.fault:
            return f"fault of the physics: {self.outcome.fault}"
        if self.outcome.drop:
            return "dropped"
        off = f"{self.outcome.theta:.2f} rad from the goal"
        return f"success: {off}" if self.outcome.success else f"not there: {off}"

    @staticmethod
    def _angles(rotations: Sequence[Array], other: Array) -> Array:
        return np.asarray(geodesic(np.stack(rotations), other)) if rotations else np.empty(0)
