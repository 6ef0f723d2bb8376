"""Two least-squares fits at a pose: how pads that press must have moved the object, and what would bring it to them.

Each is six normal equations with a prior, so that directions no finger tells about stay at zero. Compiled, without a
gradient: they are hints to the network, which learns how far to trust them.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import torch
from torch import Tensor

from tactile_kit.estimator.fingers import FINGERS, RADII, SPHERES

#: Factors that make the 16 numbers of order one: m and rad of both fits, and the four shares.
FIT_SCALE = torch.tensor([200.0] * 3 + [10.0] * 3 + [200.0] * 3 + [10.0] * 3 + [1.0] * 4)

# Standard deviations: an object's step (m, rad), a pose that is a little off, a pad's and a surface's error (m).
STEP, OFF = (0.01, 0.25), (0.005, 0.1)
PAD_ERROR, SURFACE_ERROR = 0.0015, 0.004
# A finger presses where it is pushed by some 5 mm into a surface that is less than some 12 mm away.
PRESSED, PRESSED_SOFT, NEAR, NEAR_SOFT = 0.005, 0.002, 0.012, 0.004


def fits(points: Tensor, vectors: Tensor, x: Tensor, push: Tensor, move: Tensor) -> Tensor:
    """Motion (m, rad: 6), correction (m, rad: 6) and the fingers' shares in the first (4): ``(B, 16) float32``.

    ``points, vectors (B, 16, 3)``: spheres and the vectors from them to the surface at the estimate ``x (B, 3)``;
    ``push, move (B, 4, 3)`` as of ``Fingers``; all metres, world frame. Rotations are about x.
    """
    out = torch.empty(len(x), 16)
    arrays = [part.detach().contiguous().numpy() for part in (points, vectors, x, push, move)]
    _fits(*arrays, out.numpy(), RADII.numpy())
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _solved(A, b):
    """Cholesky solution of ``A (6, 6)``, of which the lower half is read, into ``b``; both are overwritten."""
    for j in range(6):
        for k in range(j):
            A[j, j] -= A[j, k] * A[j, k]
        A[j, j] = math.sqrt(max(A[j, j], 1e-9))
        for i in range(j + 1, 6):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k]
            A[i, j] /= A[j, j]
    for i in range(6):
        for k in range(i):
            b[i] -= A[i, k] * b[k]
        b[i] /= A[i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            b[i] -= A[k, i] * b[k]
        b[i] /= A[i, i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _prior(A, size):
    A[:] = 0.0
    for k in range(3):
        A[k, k], A[3 + k, 3 + k] = 1.0 / size[0] ** 2, 1.0 / size[1] ** 2


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _fits(points, vectors, x, push, move, out, radii):
    A, C, b, c = np.empty((6, 6)), np.empty((6, 6)), np.empty(6), np.empty(6)
    lever, n, along = np.empty(3), np.empty(3), np.empty(6)
    for e in range(len(x)):
        _prior(A, STEP)
        _prior(C, OFF)
        b[:], c[:] = 0.0, 0.0
        for f in range(FINGERS):
            nearest, gap, length = 0, 1e9, 0.0
            for s in range(SPHERES * f, SPHERES * (f + 1)):
                v = vectors[e, s]
                d = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
                if d - radii[s] < gap:
                    nearest, gap, length = s, d - radii[s], d
            press = 0.0
            for k in range(3):
                n[k] = vectors[e, nearest, k] / (length + 1e-6)
                lever[k] = points[e, nearest, k] + n[k] * radii[nearest] - x[e, k]
                press += push[e, f, k] * n[k]
            share = 1.0 / (1.0 + math.exp((PRESSED - press) / PRESSED_SOFT))
            share /= 1.0 + math.exp((gap - NEAR) / NEAR_SOFT)
            out[e, 12 + f] = share
            # the surface point's speed for a unit of each coordinate: e_k, and e_k x lever
            firm = share / PAD_ERROR**2
            for k in range(3):
                one, two = (k + 1) % 3, (k + 2) % 3
                # row k of the point's motion: dx_k + r_one * lever_two - r_two * lever_one
                along[:] = 0.0
                along[k], along[3 + one], along[3 + two] = 1.0, lever[two], -lever[one]
                for i in range(6):
                    b[i] += firm * along[i] * move[e, f, k]
                    for j in range(i + 1):
                        A[i, j] += firm * along[i] * along[j]
            for k in range(3):
                one, two = (k + 1) % 3, (k + 2) % 3
                along[k], along[3 + k] = n[k], lever[one] * n[two] - lever[two] * n[one]
            touch = max(share, 1.0 if gap < 0.0 else 0.0) / SURFACE_ERROR**2
            for i in range(6):
                c[i] -= touch * along[i] * gap
                for j in range(i + 1):
                    C[i, j] += touch * along[i] * along[j]
        _solved(A, b)
        _solved(C, c)
        for i in range(6):
            out[e, i], out[e, 6 + i] = b[i], c[i]
