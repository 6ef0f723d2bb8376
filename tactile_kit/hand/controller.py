"""The joint impedance controller, integrated so that it is stable at large physics steps.

The robot runs its control law at 1 kHz (paper, section II-C). At a simulation step of 1/240 to 1/60 s explicit damping
would be unstable on these light links. The damping torque is therefore the one that backward Euler would apply,

    tau = K (q_d - q) - M (M + dt D + dt² K)⁻¹ (D + dt K) q̇,

with the mass matrix M of the driven joints taken once, at the mean grasp (the tendon makes q4 a part of q3). The
stiffness term is *not* scaled: a finger that rests against the object pushes with exactly K (q_d - q), whatever the
step. (Scaling both terms, as a fully implicit law would, makes the force on a resting contact shrink with the step: to
a tenth at 1/240 s and a fortieth at 1/60 s for q3.) The
stiffness term is stable as long as dt² K stays below twice the smallest eigenvalue of the inertia, which the drives'
reflected inertia ensures.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand import kinematics
from tactile_kit.hand.urdf import ABDUCTION_INERTIA, ARMATURE, TENDON_INERTIA

Array = NDArray[np.float64]

TORQUE_LIMIT = 1.0  # Nm
GRAVITY_DIRECTION = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class Impedance:
    """Gains of the controller: stiffness Nm/rad, damping Nms/rad, the drive's series stiffness Nm/rad."""

    stiffness: float = 5.0
    damping: float = 0.36
    series_stiffness: float = 25.0

    @property
    def ratio(self) -> float:
        """Share of the commanded deflection that the series spring leaves to the joint."""
        return self.series_stiffness / (self.stiffness + self.series_stiffness)


def _finger_blocks(matrix: Array) -> Array:
    return np.stack([matrix[4 * f : 4 * f + 4, 4 * f : 4 * f + 4] for f in range(kinematics.FINGERS)])


@functools.cache
def finger_mass_matrices() -> Array:
    """Mass matrix a finger at the mean grasp, ``(4, 4, 4)`` kg m², with what the URDF adds for the drives."""
    blocks = _finger_blocks(kinematics.mass_matrix(kinematics.MEAN_GRASP))
    blocks[:, 0, 0] += ABDUCTION_INERTIA + 3 * ARMATURE + TENDON_INERTIA  # abduction turns all links
    for link, inertia in (
        (1, ARMATURE),
        (2, ARMATURE),
        (3, TENDON_INERTIA),
    ):  # a joint turns all that hangs on it
        blocks[:, 1 : link + 1, 1 : link + 1] += inertia
    return blocks


@functools.cache
def gravity_torques(gravity: float) -> Array:
    """Torques ``(16,)`` Nm that carry each link's weight at the mean grasp, for ``gravity`` in m/s²."""
    frames = kinematics.link_frames(kinematics.MEAN_GRASP)
    torques = np.zeros(kinematics.ALL_JOINTS)
    for finger in range(kinematics.FINGERS):
        for joint, link in ((1, kinematics.PROXIMAL), (2, kinematics.MIDDLE), (3, kinematics.DISTAL)):
            centre, _ = kinematics.capsule_inertia(link)
            point = frames[finger, joint, :3, :3] @ centre + frames[finger, joint, :3, 3]
            force = link.mass * gravity * GRAVITY_DIRECTION
            for j in range(joint + 1):
                lever = np.cross(frames[finger, j, :3, 2], point - frames[finger, j, :3, 3])
                torques[4 * finger + j] -= lever @ force
    return torques


def damping_matrices(damping: Array | float, stiffness: Array | float, step: float) -> Array:
    """Damping ``(..., 4, 3, 3)`` Nms/rad that backward Euler would apply, for gains ``(...)`` and a step in s."""
    drag = np.eye(kinematics.DRIVEN) * np.asarray(damping + step * stiffness)[..., None, None, None]
    mass = kinematics.TENDON.T @ finger_mass_matrices() @ kinematics.TENDON
    return mass @ np.linalg.inv(mass + step * drag) @ drag


@numba.njit(cache=True)
def _torques(q, dq, command, stiffness, damping, limit, feedforward, out):
    for f in range(4):
        for i in range(3):
            error = command[3 * f + i] - q[4 * f + i]
            out[f, i] = feedforward[f, i] + stiffness * min(max(error, -limit), limit)
            for j in range(3):
                out[f, i] -= damping[f, i, j] * dq[4 * f + j]


@numba.njit(cache=True)
def _measured(q, command, give, limit):
    angles = np.empty_like(q)
    for i in range(len(q)):
        angles[i] = q[i] + give * min(max(command[i] - q[i], -limit), limit)
    return angles


class ImpedanceController:
    """Torques for the 12 driven joints.

    Args:
        impedance: gains.
        step: simulation step, s.
        gravity: m/s²; the fingers' own weight is compensated, as on the robot.
    """

    def __init__(self, impedance: Impedance, step: float, gravity: float = 9.81) -> None:
        self.impedance, self.step = impedance, step
        self._stiffness = impedance.stiffness * impedance.ratio
        drag = impedance.damping * impedance.ratio
        self.damping = np.ascontiguousarray(damping_matrices(drag, self._stiffness, step))
        self._limit = TORQUE_LIMIT / self._stiffness
        self.compensate(gravity)
        self._out = np.empty((kinematics.FINGERS, kinematics.DRIVEN))

    def compensate(self, gravity: float) -> None:
        """Carry the fingers' weight under ``gravity`` m/s² from now on."""
        self.feedforward = gravity_torques(gravity).reshape(kinematics.FINGERS, 4) @ kinematics.TENDON

    def torques(self, q: Array, dq: Array, command: Array) -> Array:
        """Torques ``(4 fingers, 3)`` Nm for angles and speeds ``(16,)`` and filtered command ``(12,)`` rad.

        The returned array is overwritten by the next call.
        """
        _torques(q, dq, command, self._stiffness, self.damping, self._limit, self.feedforward, self._out)
        return self._out

    def measured(self, q: Array, command: Array) -> Array:
        """Motor-side angles ``(12,)`` that the robot would measure for driven joint angles ``(12,)``.

        The series spring stretches under the drive torque, so the motor stands between joint and command.
        """
        return _measured(q, command, 1.0 - self.impedance.ratio, self._limit)


class CommandFilter:
    """First-order low pass on the commanded angles, exact for a command held over a step.

    Args:
        time_constant: s, 0.27 (the lab's published value for this hand).
        step: s between updates.
    """

    def __init__(self, time_constant: float = 0.27, step: float = 1 / 60) -> None:
        self._keep = float(np.exp(-step / time_constant))
        self.value = np.zeros(kinematics.JOINTS)

    def reset(self, value: Array) -> None:
        """Start from ``value`` ``(12,)`` rad."""
        self.value = np.array(value, dtype=np.float64)

    def update(self, target: Array) -> Array:
        """Advance one step towards ``target`` ``(12,)`` and return the filtered command."""
        self.value = target + self._keep * (self.value - target)
        return self.value
