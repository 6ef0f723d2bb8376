"""Where the fingertips are and which joint angles bring them elsewhere, fast enough to be asked at every step."""

from __future__ import annotations

import math

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
LINKS = np.array([kinematics.PROXIMAL_LENGTH, kinematics.MIDDLE_LENGTH, TIP])  # m


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


# The same for many hands at once. A finger moves in a plane that its first joint turns, where it takes few numbers.
@numba.njit(cache=True, error_model="numpy")
def _reach(links, q):
    """Radius and height of a tip in its finger's plane (m), and what the third joint changes of them (m/rad)."""
    radius, height, outwards, upwards = 0.0, 0.0, 0.0, 0.0
    for link in range(3):
        turn = q[1] + link * q[2]  # the passive joint follows the third
        along, across = links[link] * math.cos(turn), links[link] * math.sin(turn)
        radius += along
        height += across
        outwards -= link * across
        upwards += link * along
    return radius, height, outwards, upwards


@numba.njit(cache=True, error_model="numpy")
def _tips_of_many(frames, links, q):
    centres = np.empty(q.shape)
    for hand in range(len(q)):
        for finger in range(4):
            radius, height, _, _ = _reach(links, q[hand, finger])
            x, y = radius * math.cos(q[hand, finger, 0]), radius * math.sin(q[hand, finger, 0])
            for k in range(3):
                row = frames[finger, k]
                centres[hand, finger, k] = row[0] * x + row[1] * y + row[2] * height + row[3]
    return centres


@numba.njit(cache=True, error_model="numpy")
def _solve_many(frames, links, q, targets, lower, upper):
    q = q.copy()
    aim = np.empty(3)
    for hand in range(len(q)):
        for finger in range(4):
            angles, frame = q[hand, finger], frames[finger]
            for k in range(3):  # in the frame of the first joint
                aim[k] = 0.0
                for m in range(3):
                    aim[k] += frame[m, k] * (targets[hand, finger, m] - frame[m, 3])
            for _ in range(ITERATIONS):
                radius, height, a, b = _reach(links, angles)
                cosine, sine = math.cos(angles[0]), math.sin(angles[0])
                sideways = cosine * aim[1] - sine * aim[0]
                outwards, upwards = cosine * aim[0] + sine * aim[1] - radius, aim[2] - height
                turn = radius * sideways / (radius * radius + DAMPING)
                # two equations for the other two joints, of Jacobian ((-height, a), (radius, b))
                p, mixed, r = (
                    height**2 + radius**2 + DAMPING,
                    radius * b - height * a,
                    a * a + b * b + DAMPING,
                )
                s, t = radius * upwards - height * outwards, a * outwards + b * upwards
                determinant = p * r - mixed * mixed
                second, third = (r * s - mixed * t) / determinant, (p * t - mixed * s) / determinant
                largest = max(abs(turn), max(abs(second), abs(third)))
                shrink = LONGEST / largest if largest > LONGEST else 1.0
                for i, step in enumerate((turn, second, third)):
                    angles[i] = min(max(angles[i] + shrink * step, lower[finger, i]), upper[finger, i])
                if largest < 1e-4:
                    break
    return q


def tips_of_many(joints: Array) -> Array:
    """:func:`tips` of ``n`` hands: ``(n, 4, 3)`` m for driven angles ``(n, 12)`` rad."""
    return _tips_of_many(ORIGINS[:, 0], LINKS, joints.reshape(-1, kinematics.FINGERS, kinematics.DRIVEN))


def joints_for_many(targets: Array, near: Array) -> Array:
    """:func:`joints_for` of ``n`` hands: ``(n, 12)`` rad for ``targets (n, 4, 3)`` m, from ``near (n, 12)`` rad."""
    start = near.reshape(-1, kinematics.FINGERS, kinematics.DRIVEN)
    return _solve_many(ORIGINS[:, 0], LINKS, start, targets, LOWER, UPPER).reshape(near.shape)
