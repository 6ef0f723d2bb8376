"""Where the fingertips are and which joint angles bring them elsewhere, fast enough to be asked at every step."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand import kinematics

Array = NDArray[np.float64]

ITERATIONS = 12
LONGEST = 0.3  # rad a joint and iteration
DAMPING = 1e-5  # m^2, keeps stretched fingers calm
LOWER = kinematics.JOINT_LOWER.reshape(kinematics.FINGERS, kinematics.DRIVEN)
UPPER = kinematics.JOINT_UPPER.reshape(kinematics.FINGERS, kinematics.DRIVEN)
TIP = float(kinematics.DISTAL.capsule.end)  # m along the distal link


def _origins() -> Array:
    """Frames of the joints at angle zero ``(4 fingers, 4 joints, 4, 4)``: in the parent's, the first in the world."""
    frames = np.stack([np.stack(kinematics.joint_origins(finger)) for finger in range(kinematics.FINGERS)])
    hand = np.eye(4)
    hand[:3, :3], hand[:3, 3] = kinematics.HAND_ROTATION, kinematics.HAND_POSITION
    frames[:, 0] = hand @ frames[:, 0]
    return frames


ORIGINS = _origins()


@numba.njit(cache=True)
def tip_of(origins, q, end):
    """Centre ``(3,)`` m of one finger's outer tip sphere and its Jacobian ``(3, 3)`` m/rad."""
    axes, points = np.empty((4, 3)), np.empty((4, 3))
    frame = np.eye(4)
    for joint in range(4):
        angle = q[min(joint, 2)]  # the passive joint follows the third
        turn = np.eye(4)
        turn[0, 0] = turn[1, 1] = np.cos(angle)
        turn[1, 0] = np.sin(angle)
        turn[0, 1] = -turn[1, 0]
        frame = frame @ origins[joint] @ turn
        axes[joint], points[joint] = frame[:3, 2], frame[:3, 3]
    centre = frame[:3, 3] + end * frame[:3, 1]
    jacobian = np.zeros((3, 3))
    for joint in range(4):
        jacobian[:, min(joint, 2)] += np.cross(axes[joint], centre - points[joint])
    return centre, jacobian


@numba.njit(cache=True)
def tips_of(origins, q, end):
    """Centres ``(4, 3)`` m for angles ``(4, 3)``."""
    centres = np.empty((4, 3))
    for finger in range(4):
        centres[finger] = tip_of(origins[finger], q[finger], end)[0]
    return centres


@numba.njit(cache=True)
def solve(origins, q, targets, lower, upper, end):
    """Angles ``(4, 3)`` that bring the tips to ``targets (4, 3)`` m; see :func:`joints_for`."""
    q = q.copy()
    for finger in range(4):
        for _ in range(ITERATIONS):
            centre, jacobian = tip_of(origins[finger], q[finger], end)
            square = jacobian.T @ jacobian + DAMPING * np.eye(3)
            step = np.linalg.solve(square, jacobian.T @ (targets[finger] - centre))
            largest = np.abs(step).max()
            if largest > LONGEST:
                step *= LONGEST / largest
            q[finger] = np.minimum(np.maximum(q[finger] + step, lower[finger]), upper[finger])
            if largest < 1e-4:
                break
    return q


def tips(joints: Array) -> Array:
    """``kinematics.tip_centres``, compiled: ``(4, 3)`` m, world frame, for driven angles ``(12,)`` rad."""
    return tips_of(ORIGINS, joints.reshape(kinematics.FINGERS, kinematics.DRIVEN), TIP)


def joints_for(targets: Array, near: Array) -> Array:
    """Driven angles ``(12,)`` rad, within limits, that bring the tips to ``targets (4, 3)`` m or as close as they go.

    Damped least squares from ``near (12,)`` rad.
    """
    start = near.reshape(kinematics.FINGERS, kinematics.DRIVEN)
    return solve(ORIGINS, start, targets, LOWER, UPPER, TIP).ravel()
