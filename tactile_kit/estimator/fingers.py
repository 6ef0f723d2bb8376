"""What a control step's measurements say of the fingers: where they are, how they push, how they moved.

Forward kinematics of the measured angles, with the drive's series spring taken out: a pressed finger's angle is
measured at the motor, and without that its tip would seem millimetres inside the object. Compiled, without a gradient.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
import torch
from torch import Tensor

from tactile_kit.hand import kinematics
from tactile_kit.hand.controller import TORQUE_LIMIT, Impedance
from tactile_kit.hand.inverse import ORIGINS

SAMPLES, JOINTS, FINGERS = 6, kinematics.JOINTS, kinematics.FINGERS
SPHERES = (
    4  # a finger: three along the distal capsule, from the inner end to the tip, and the middle link's end
)
TIP, PAD = 2, 1  # of them, the one that pushes furthest out, and the one in the middle of the pad
MEMORY = 1 + 4 * JOINTS  # steps so far (0 or 1), then angles, command, error and joint angles of the last one
ANGLES = 6 * JOINTS  # numbers that describe the joints
SMOOTHING = 0.4  # of the control error, which changes slowly: share of the newest step
GIVE = Impedance().stiffness / Impedance().series_stiffness  # rad at the spring for a rad of control error
LIMIT = TORQUE_LIMIT / Impedance().series_stiffness  # rad, where the torque saturates

_TIP = kinematics.DISTAL.capsule
_ALONG = np.linspace(_TIP.start, _TIP.end, 3)
_BASES = np.stack([np.concatenate([frame[:3, :3].T, frame[None, :3, 3]]) for frame in ORIGINS[:, 0]])
_LENGTHS = np.array([kinematics.PROXIMAL_LENGTH, kinematics.MIDDLE_LENGTH, kinematics.MIDDLE.capsule.end])
_HAND = (_BASES, _LENGTHS, _ALONG)  # handed in: numba's cache takes no arrays of the module's
#: Radii of the spheres ``(16,)`` m, with the millimetre that Bullet's convex meshes stand out by.
RADII = torch.tensor(([_TIP.radius] * 3 + [kinematics.MIDDLE.capsule.radius]) * FINGERS) + 0.001


class Fingers(NamedTuple):
    """Of T steps of B environments (or of one step, without the first axis), world frame.

    joints: ``(T, B, 72)``, of order one; points: ``(T, B, 16, 3)`` m, centres of the spheres; push: ``(T, B, 4, 3)`` m,
    from each tip to where it is commanded; move: ``(T, B, 4, 3)`` m, what each pad moved since the step before;
    memory: ``(T, B, MEMORY)``, what the next step needs.
    """

    joints: Tensor
    points: Tensor
    push: Tensor
    move: Tensor
    memory: Tensor

    def steps(self) -> list[Fingers]:
        """One by one."""
        return [Fingers(*parts) for parts in zip(*(part.unbind(0) for part in self), strict=True)]


def fingers(z: Tensor, started: Tensor, memory: Tensor) -> Fingers:
    """Fingers from measurements ``z (T, B, 144)`` rad.

    Args:
        started: ``(T, B) bool``, steps without a past. memory: ``(B, MEMORY)`` before the first.
    """
    steps, count = z.shape[:2]
    out = Fingers(
        torch.empty(steps, count, ANGLES),
        torch.empty(steps, count, FINGERS * SPHERES, 3),
        torch.empty(steps, count, FINGERS, 3),
        torch.empty(steps, count, FINGERS, 3),
        torch.empty(steps, count, MEMORY),
    )
    measured = z.detach().to(torch.float32).reshape(steps, count, SAMPLES, 2, JOINTS).contiguous()
    before = memory.detach().to(torch.float32).contiguous()
    arrays = [measured.numpy(), started.contiguous().numpy(), before.numpy()]
    _fingers(*arrays, *(part.numpy() for part in out), _HAND, kinematics.MEAN_GRASP)
    return out


def spheres(q: np.ndarray) -> np.ndarray:
    """Centres ``(E, 16, 3) float32`` m of the fingers' spheres for true driven angles ``q (E, 12)`` rad."""
    out = np.empty((len(q), FINGERS * SPHERES, 3), np.float32)
    _all_spheres(_HAND, np.ascontiguousarray(q, np.float64), out)
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _spheres(hand, q, out):
    """Centres ``out (16, 3)`` of all fingers' spheres for the driven angles ``q (12,)``."""
    bases, lengths, along = hand
    for f in range(FINGERS):
        q1, q2, q3 = q[3 * f], q[3 * f + 1], q[3 * f + 2]
        s1, c1 = math.sin(q1), math.cos(q1)
        s2, c2 = math.sin(q2), math.cos(q2)
        s3, c3 = math.sin(q2 + q3), math.cos(q2 + q3)
        s4, c4 = math.sin(q2 + 2.0 * q3), math.cos(q2 + 2.0 * q3)  # the passive joint follows the third
        for k in range(3):
            u = c1 * bases[f, 0, k] + s1 * bases[f, 1, k]
            w = bases[f, 2, k]
            knee = bases[f, 3, k] + lengths[0] * (c2 * u + s2 * w)
            last = knee + lengths[1] * (c3 * u + s3 * w)
            for point in range(3):
                out[SPHERES * f + point, k] = last + along[point] * (c4 * u + s4 * w)
            out[SPHERES * f + 3, k] = knee + lengths[2] * (c3 * u + s3 * w)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _all_spheres(hand, q, out):
    for e in range(len(q)):
        _spheres(hand, q[e], out[e])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _fingers(z, started, before, joints, points, push, move, memory, hand, grasp):
    steps, count = z.shape[0], z.shape[1]
    now, aim, old = np.empty((16, 3)), np.empty((16, 3)), np.empty((16, 3))
    angle, command, joint, past = np.empty(JOINTS), np.empty(JOINTS), np.empty(JOINTS), np.empty(JOINTS)
    for t in range(steps):
        for b in range(count):
            last = before[b] if t == 0 else memory[t - 1, b]
            fresh = started[t, b] or last[0] == 0.0
            kept, told = memory[t, b], joints[t, b]
            kept[0] = 1.0
            for j in range(JOINTS):
                a, e = 0.0, 0.0
                for sample in range(SAMPLES):
                    a += z[t, b, sample, 0, j] / SAMPLES
                    e += z[t, b, sample, 1, j] / SAMPLES
                first = z[t, b, 0, 0, j] + z[t, b, 0, 1, j]
                c = z[t, b, SAMPLES - 1, 0, j] + z[t, b, SAMPLES - 1, 1, j]
                smooth = e if fresh else last[1 + 2 * JOINTS + j] + SMOOTHING * (e - last[1 + 2 * JOINTS + j])
                # the command is exact; what is behind the spring is the command less the error less its deflection
                q = a + e - smooth - min(max(GIVE * smooth, -LIMIT), LIMIT)
                was = a if fresh else last[1 + j]
                asked = first if fresh else last[1 + JOINTS + j]
                stood = q if fresh else last[1 + 3 * JOINTS + j]
                angle[j], command[j], joint[j], past[j] = a, c, q, stood
                told[j] = (a - grasp[j]) / 0.3
                told[JOINTS + j] = (c - a) / 0.1
                told[2 * JOINTS + j] = (a - was) / 0.05
                told[3 * JOINTS + j] = (c - asked) / 0.05
                told[4 * JOINTS + j] = (q - stood) / 0.05
                told[5 * JOINTS + j] = (a - q) / 0.02
                kept[1 + j], kept[1 + JOINTS + j] = a, c
                kept[1 + 2 * JOINTS + j], kept[1 + 3 * JOINTS + j] = smooth, q
            _spheres(hand, joint, now)
            _spheres(hand, command, aim)
            _spheres(hand, past, old)
            for f in range(FINGERS):
                for k in range(3):
                    for point in range(SPHERES):
                        points[t, b, SPHERES * f + point, k] = now[SPHERES * f + point, k]
                    push[t, b, f, k] = aim[SPHERES * f + TIP, k] - now[SPHERES * f + TIP, k]
                    move[t, b, f, k] = now[SPHERES * f + PAD, k] - old[SPHERES * f + PAD, k]
