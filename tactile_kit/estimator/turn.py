"""R̂ <- exp(r) R̂ for a batch, compiled, forwards and backwards.

Written with torch operations (see ``so3``, the twin in the tests) this small sum would be some forty kernel
launches a step and half of the time of a training pass. The gradient is the closed form: with G the gradient
of R' = exp(r) R,

    dL/dR = exp(r)^T G,    dL/dr = J_l(r)^T sum_c R'_c x G_c   (columns c, left Jacobian J_l of SO(3)).
"""

from __future__ import annotations

import math

import numba
import numpy as np
import torch
from torch import Tensor


def turned(R: Tensor, r: Tensor) -> Tensor:
    """exp(r) R, orthonormal: R ``(B, 3, 3)``, r ``(B, 3)`` rad, float32 or float64 on the CPU; same dtype out.

    One Newton step removes the rounding that a hundred products would gather. No gradient: ``step.moved`` has one.
    """
    out = torch.empty(R.shape, dtype=R.dtype)
    forward(R.detach().contiguous().numpy(), r.detach().contiguous().numpy(), out.numpy())
    return out


@numba.njit(cache=True, nogil=True)
def _coefficients(square):
    """sin a / a, (1 - cos a) / a^2, (a - sin a) / a^3 for the squared angle; Taylor where the quotients cancel."""
    if square < 1e-4:
        return (
            1.0 - square / 6.0 + square * square / 120.0,
            0.5 - square / 24.0 + square * square / 720.0,
            1.0 / 6.0 - square / 120.0 + square * square / 5040.0,
        )
    angle = math.sqrt(square)
    half = math.sin(0.5 * angle)
    sine = math.sin(angle)
    return sine / angle, 2.0 * half * half / square, (angle - sine) / (angle * square)


@numba.njit(cache=True, nogil=True)
def _rotation(x, y, z, out):
    """exp of (x, y, z) into out (3, 3): I + A [r] + B (r r^T - |r|^2 I)."""
    square = x * x + y * y + z * z
    a, b, _ = _coefficients(square)
    out[0, 0], out[0, 1], out[0, 2] = 1.0 + b * (x * x - square), b * x * y - a * z, b * x * z + a * y
    out[1, 0], out[1, 1], out[1, 2] = b * x * y + a * z, 1.0 + b * (y * y - square), b * y * z - a * x
    out[2, 0], out[2, 1], out[2, 2] = b * x * z - a * y, b * y * z + a * x, 1.0 + b * (z * z - square)


@numba.njit(cache=True, nogil=True)
def forward(R, r, out):
    """exp(r) R into ``out (B, 3, 3)``."""
    turn, product = np.empty((3, 3)), np.empty((3, 3))
    for n in range(len(R)):
        _rotation(float(r[n, 0]), float(r[n, 1]), float(r[n, 2]), turn)
        for i in range(3):
            for j in range(3):
                product[i, j] = turn[i, 0] * R[n, 0, j] + turn[i, 1] * R[n, 1, j] + turn[i, 2] * R[n, 2, j]
        # nearest rotation by one Newton step: P (3 I - P^T P) / 2
        for j in range(3):
            for k in range(3):
                inner = 0.0
                for i in range(3):
                    inner += product[i, j] * product[i, k]
                turn[j, k] = (1.5 if j == k else 0.0) - 0.5 * inner
        for i in range(3):
            for j in range(3):
                out[n, i, j] = (
                    product[i, 0] * turn[0, j] + product[i, 1] * turn[1, j] + product[i, 2] * turn[2, j]
                )


@numba.njit(cache=True, nogil=True)
def backward(r, out, gradient, R_gradient, r_gradient):
    """Gradients of R and r from that of ``out``, what :func:`forward` gave."""
    turn = np.empty((3, 3))
    for n in range(len(r)):
        x, y, z = float(r[n, 0]), float(r[n, 1]), float(r[n, 2])
        _rotation(x, y, z, turn)
        wx, wy, wz = 0.0, 0.0, 0.0
        for c in range(3):
            o0, o1, o2 = float(out[n, 0, c]), float(out[n, 1, c]), float(out[n, 2, c])
            g0, g1, g2 = float(gradient[n, 0, c]), float(gradient[n, 1, c]), float(gradient[n, 2, c])
            wx += o1 * g2 - o2 * g1
            wy += o2 * g0 - o0 * g2
            wz += o0 * g1 - o1 * g0
            for i in range(3):
                R_gradient[n, i, c] = turn[0, i] * g0 + turn[1, i] * g1 + turn[2, i] * g2
        _, b, d = _coefficients(x * x + y * y + z * z)
        cx, cy, cz = y * wz - z * wy, z * wx - x * wz, x * wy - y * wx
        r_gradient[n, 0] = wx - b * cx + d * (y * cz - z * cy)
        r_gradient[n, 1] = wy - b * cy + d * (z * cx - x * cz)
        r_gradient[n, 2] = wz - b * cz + d * (x * cy - y * cx)
