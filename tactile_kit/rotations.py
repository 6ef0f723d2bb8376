"""Rotations in SO(3) as batches of matrices.

Everything here takes and returns NumPy arrays of shape ``(..., 3, 3)`` in the precision it is given. Quaternions
appear only at Bullet's door, ordered (x, y, z, w). The 6-D form that networks read is the first two columns, one
after the other.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[Any]  # of floats


def random_rotations(rng: np.random.Generator, count: int) -> Array:
    """Rotations uniform on SO(3) (Haar), ``(count, 3, 3) float64``."""
    quaternions = rng.standard_normal((count, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    return from_quaternion(quaternions)


def octahedral() -> Array:
    """The 24 rotations of the octahedral group, ``(24, 3, 3) float64``, identity first (paper, section III-C)."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[np.arange(3), order] = signs
            if np.linalg.det(matrix) > 0:
                found.append(matrix)
    return np.array(found)


def geodesic(a: Array, b: Array) -> Array:
    """Angle of the rotation between ``a`` and ``b``, rad in [0, pi]; shapes ``(..., 3, 3)`` broadcast.

    Full precision everywhere: from the chord below a right angle, where the trace loses digits, and from sine and
    cosine above, where the chord does.
    """
    chord = np.linalg.norm(a - b, axis=(-2, -1)) / 8.0**0.5
    turn = a @ np.swapaxes(b, -1, -2)
    x = turn[..., 2, 1] - turn[..., 1, 2]
    y = turn[..., 0, 2] - turn[..., 2, 0]
    z = turn[..., 1, 0] - turn[..., 0, 1]
    sine, cosine = np.sqrt(x * x + y * y + z * z), np.trace(turn, axis1=-2, axis2=-1) - 1.0
    return np.where(cosine > 0.0, 2.0 * np.arcsin(np.minimum(chord, 1.0)), np.arctan2(sine, cosine))


def to_6d(rotation: Array) -> Array:
    """First two columns of ``(..., 3, 3)``, concatenated: ``(..., 6)``."""
    return np.concatenate([rotation[..., :, 0], rotation[..., :, 1]], axis=-1)


def exp(vector: Array) -> Array:
    """Rotation by ``|v|`` rad about ``v``: ``(..., 3)`` to ``(..., 3, 3)``."""
    vector = np.asarray(vector)
    matrices = Rotation.from_rotvec(vector.reshape(-1, 3)).as_matrix()
    return matrices.reshape(*vector.shape[:-1], 3, 3)


def log(rotation: Array) -> Array:
    """Rotation vector (rad) of ``(..., 3, 3)``: ``(..., 3)``."""
    rotation = np.asarray(rotation)
    vectors = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_rotvec()
    return vectors.reshape(*rotation.shape[:-2], 3)


def from_quaternion(quaternion: Array) -> Array:
    """Unit quaternions (x, y, z, w) ``(..., 4)`` to matrices ``(..., 3, 3)``."""
    x, y, z, w = np.moveaxis(np.asarray(quaternion), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def to_quaternion(rotation: Array) -> Array:
    """Matrices ``(..., 3, 3)`` to unit quaternions (x, y, z, w) ``(..., 4)``."""
    rotation = np.asarray(rotation)
    return Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_quat().reshape(*rotation.shape[:-2], 4)
