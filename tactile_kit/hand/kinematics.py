"""Kinematics of the four-fingered hand: the table, forward kinematics and the mass matrix.

Facts: DLR-Hand II as published in the lab's public hand description and grasp data (joint frames, limits, masses,
capsules, mean grasp). Each finger has three driven joints, q1 abduction, q2 and q3 flexion, and a passive distal
joint q4 = q3. All in SI units; the hand frame is placed in the world so that the nominal object centre is the origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

FINGERS = 4
DRIVEN = 3  # driven joints a finger
JOINTS = FINGERS * DRIVEN  # 12, the policy's degrees of freedom
ALL_JOINTS = FINGERS * 4  # 16, with the passive distal joints
DRIVEN_INDEX = np.array([4 * finger + joint for finger in range(FINGERS) for joint in range(DRIVEN)])
TENDON = np.array(
    [[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1]]
)  # a finger's four joints from its three drives


@dataclass(frozen=True)
class Capsule:
    """A capsule along the link's length: radius and the two sphere centres' coordinates on that axis (m)."""

    radius: float
    start: float
    end: float


@dataclass(frozen=True)
class Link:
    """One link: name, mass (kg), capsule and the axis it lies along."""

    name: str
    mass: float
    capsule: Capsule
    axis: int  # 0: x, 1: y


HAND_POSITION = np.array([-0.065, 0.030, 0.258])
HAND_ROTATION = Rotation.from_euler("y", 160, degrees=True).as_matrix()
FINGER_POSITIONS = np.array(
    [
        [-0.005785, -0.061149, 0.132621],
        [-0.048151, -0.012102, 0.133300],
        [-0.045982, 0.027692, 0.138844],
        [0.052264, 0.026986, 0.102620],
    ]
)
FINGER_RPY = np.array(
    [
        [0.144645, -1.485459, -2.446542],
        [-0.384641, -1.337290, -2.708520],
        [-0.384641, -1.337290, -2.708520],
        [0.547040, -0.982373, -0.578402],
    ]
)
BASE_MASS = 0.1
PROXIMAL = Link("proximal", 0.100, Capsule(0.0165, 0.016, 0.066), axis=0)
MIDDLE = Link("middle", 0.075, Capsule(0.0145, 0.004, 0.036), axis=0)
DISTAL = Link("distal", 0.025, Capsule(0.01417, 0.0159, 0.0331), axis=1)
PROXIMAL_LENGTH = 0.075
MIDDLE_LENGTH = 0.040

JOINT_LOWER = np.tile([-0.5, -0.34, -0.13], FINGERS)
JOINT_UPPER = np.tile([0.5, 1.5, 1.7], FINGERS)
MEAN_GRASP = np.deg2rad([22.0, 3, 15, 0, 16, 14, 0, 29, 21, -2, 13, 6])  # q̄0
# A command beyond the object's surface. Held for 5 s with 0.15 of the range as noise it keeps 31 of 32 random
# objects and sizes of Geometric 8, the mean grasp (plus 0.1 on q3) 8 of 32.
FIRM_GRASP = MEAN_GRASP + np.tile([0.0, 0.35, 0.35], FINGERS)


def expand(joints: Array) -> Array:
    """Driven angles ``(..., 12)`` to all angles ``(..., 16)``, the passive joint following q3."""
    joints = np.asarray(joints, dtype=np.float64).reshape(*np.shape(joints)[:-1], FINGERS, DRIVEN)
    return np.concatenate([joints, joints[..., 2:3]], axis=-1).reshape(*joints.shape[:-2], ALL_JOINTS)


def _homogeneous(rotation: Array, translation: Array) -> Array:
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = rotation, translation
    return frame


def joint_origins(finger: int) -> list[Array]:
    """Frames of the four joints at angle zero, each in its parent's frame, ``(4, 4)``; the first in the hand frame."""
    base = _homogeneous(Rotation.from_euler("xyz", FINGER_RPY[finger]).as_matrix(), FINGER_POSITIONS[finger])
    return [
        base,
        _homogeneous(Rotation.from_euler("x", 90, degrees=True).as_matrix(), np.zeros(3)),
        _homogeneous(np.eye(3), np.array([PROXIMAL_LENGTH, 0, 0])),
        _homogeneous(
            Rotation.from_euler("z", -90, degrees=True).as_matrix(), np.array([MIDDLE_LENGTH, 0, 0])
        ),
    ]


def link_frames(joints: Array) -> Array:
    """World frames of all links, ``(4 fingers, 4 joints, 4, 4)``, for driven angles ``(12,)`` in rad."""
    angles = expand(joints).reshape(FINGERS, 4)
    world = _homogeneous(HAND_ROTATION, HAND_POSITION)
    frames = np.empty((FINGERS, 4, 4, 4))
    for finger in range(FINGERS):
        frame = world
        for joint, origin in enumerate(joint_origins(finger)):
            turn = _homogeneous(Rotation.from_euler("z", angles[finger, joint]).as_matrix(), np.zeros(3))
            frame = frame @ origin @ turn
            frames[finger, joint] = frame
    return frames


def tip_centres(joints: Array) -> Array:
    """Centres of the outer sphere of each fingertip capsule, ``(4, 3)`` m, world frame."""
    frames = link_frames(joints)[:, 3]
    return frames[:, :3, 3] + frames[:, :3, 1] * DISTAL.capsule.end


def capsule_inertia(link: Link) -> tuple[Array, Array]:
    """Centre of mass ``(3,)`` and inertia ``(3, 3)`` about it of a link's capsule of uniform density, link frame."""
    radius, length = link.capsule.radius, link.capsule.end - link.capsule.start
    cylinder, ball = np.pi * radius**2 * length, 4.0 / 3.0 * np.pi * radius**3
    cylinder_mass = link.mass * cylinder / (cylinder + ball)
    ball_mass = link.mass - cylinder_mass
    along = cylinder_mass * radius**2 / 2 + ball_mass * 2 * radius**2 / 5
    # each half ball's centre of mass lies 3r/8 beyond the cylinder's end
    across = cylinder_mass * (radius**2 / 4 + length**2 / 12)
    across += ball_mass * (2 * radius**2 / 5 + length**2 / 4 + 3 * radius * length / 8)
    centre, inertia = np.zeros(3), np.full(3, across)
    centre[link.axis] = (link.capsule.start + link.capsule.end) / 2
    inertia[link.axis] = along
    return centre, np.diag(inertia)


def mass_matrix(joints: Array) -> Array:
    """Joint-space mass matrix ``(16, 16)`` kg m² at driven angles ``(12,)``: the sum of J^T M J over the links."""
    frames = link_frames(joints)
    total = np.zeros((ALL_JOINTS, ALL_JOINTS))
    for finger in range(FINGERS):
        # the abduction joint carries no link of its own: proximal, middle and distal hang on joints 2, 3 and 4
        for joint, link in ((1, PROXIMAL), (2, MIDDLE), (3, DISTAL)):
            centre, inertia = capsule_inertia(link)
            rotation = frames[finger, joint, :3, :3]
            point = frames[finger, joint, :3, 3] + rotation @ centre
            linear, angular = np.zeros((3, 4)), np.zeros((3, 4))
            for j in range(joint + 1):
                axis = frames[finger, j, :3, 2]
                angular[:, j] = axis
                linear[:, j] = np.cross(axis, point - frames[finger, j, :3, 3])
            block = slice(4 * finger, 4 * finger + 4)
            total[block, block] += link.mass * linear.T @ linear
            total[block, block] += angular.T @ rotation @ inertia @ rotation.T @ angular
    return total
