"""Distances between poses, each as one compiled, differentiable operation over a whole batch of states.

With torch operations (see ``loss.shape_distance`` and ``so3.geodesic``, the twins in the tests) they would write and
read a dozen arrays of the size of the basis-point vectors, and take as long as the recurrence itself.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}
_TINY = 1e-20


def vector_distance(vectors: Tensor, truth: Tensor) -> Tensor:
    """d_v (paper, eq. 5): mean difference of magnitudes, ``vectors (N, K, 3)`` and ``truth (N, K)`` in m: ``(N,)`` m.

    float32 or float64 on the CPU. Differentiable in ``vectors``; the gradient at a zero vector is zero.
    """
    return _VectorDistance.apply(vectors, truth)


def angle(R_hat: Tensor, R: Tensor) -> Tensor:
    """The geodesic angle d(R̂, R), rad in [0, pi]: ``(N, 3, 3)`` twice to ``(N,)``.

    Differentiable in ``R_hat``, along rotations only; zero gradient at 0 and pi, where there is none.
    """
    return _Angle.apply(R_hat, R)


class _VectorDistance(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, vectors: Tensor, truth: Tensor) -> Tensor:
        out = torch.empty(len(vectors), dtype=vectors.dtype)
        v, d = vectors.detach().contiguous(), truth.detach().contiguous()
        _distances(v.numpy(), d.numpy(), out.numpy())
        ctx.save_for_backward(v, d)
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        v, d = ctx.saved_tensors
        out = torch.empty_like(v)
        _distances_backward(v.numpy(), d.numpy(), gradient.contiguous().numpy(), out.numpy())
        return out, None


class _Angle(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, R_hat: Tensor, R: Tensor) -> Tensor:
        a, b = R_hat.detach().contiguous(), R.detach().contiguous()
        out, slope = torch.empty(len(a), dtype=a.dtype), torch.empty_like(a)
        _angles(a.numpy(), b.numpy(), out.numpy(), slope.numpy())
        ctx.save_for_backward(slope)
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        (slope,) = ctx.saved_tensors
        return slope * gradient[:, None, None], None


@numba.njit(fastmath={"contract", "reassoc"}, **_OPTIONS)
def _distances(vectors, truth, out):
    count, points, _ = vectors.shape
    for n in range(count):
        total = 0.0
        for k in range(points):
            x, y, z = vectors[n, k, 0], vectors[n, k, 1], vectors[n, k, 2]
            total += abs(math.sqrt(x * x + y * y + z * z) - truth[n, k])
        out[n] = total / points


@numba.njit(fastmath={"contract", "reassoc"}, **_OPTIONS)
def _distances_backward(vectors, truth, gradient, out):
    count, points, _ = vectors.shape
    for n in range(count):
        share = gradient[n] / points
        for k in range(points):
            x, y, z = vectors[n, k, 0], vectors[n, k, 1], vectors[n, k, 2]
            square = x * x + y * y + z * z
            length = math.sqrt(max(square, _TINY))
            off = length - truth[n, k]
            factor = share / length * (1.0 if off > 0.0 else (-1.0 if off < 0.0 else 0.0))
            factor = factor if square > _TINY else 0.0
            out[n, k, 0], out[n, k, 1], out[n, k, 2] = factor * x, factor * y, factor * z


@numba.njit(**_OPTIONS)
def _angles(a, b, out, slope):
    """Angle of D = A B^T, and its derivative by A: with D's sine s, cosine c and axis, (c ds - s dc) B."""
    part = np.empty((3, 3))
    for n in range(len(a)):
        for i in range(3):
            for j in range(3):
                part[i, j] = a[n, i, 0] * b[n, j, 0] + a[n, i, 1] * b[n, j, 1] + a[n, i, 2] * b[n, j, 2]
        x, y, z = (
            0.5 * (part[2, 1] - part[1, 2]),
            0.5 * (part[0, 2] - part[2, 0]),
            0.5 * (part[1, 0] - part[0, 1]),
        )
        cosine = 0.5 * (part[0, 0] + part[1, 1] + part[2, 2] - 1.0)
        sine = math.sqrt(x * x + y * y + z * z)
        out[n] = math.atan2(sine, cosine)
        scale = 0.5 * cosine / sine if sine > 1e-12 else 0.0
        x, y, z, level = scale * x, scale * y, scale * z, -0.5 * sine
        part[0, 0] = part[1, 1] = part[2, 2] = level
        part[2, 1], part[1, 2], part[0, 2], part[2, 0], part[1, 0], part[0, 1] = x, -x, y, -y, z, -z
        for i in range(3):
            for j in range(3):
                slope[n, i, j] = part[i, 0] * b[n, 0, j] + part[i, 1] * b[n, 1, j] + part[i, 2] * b[n, 2, j]
