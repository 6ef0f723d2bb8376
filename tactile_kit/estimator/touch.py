"""What the finger cell's transition sees, as one compiled, differentiable operation.

With torch operations (the twin in the tests) these two hundred numbers would be some forty kernel launches a step, and
half of the time of a training pass.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from tactile_kit.estimator.fingers import ANGLES, FINGERS, PAD, RADII, SPHERES, Fingers
from tactile_kit.estimator.fits import FIT_SCALE, fits
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.estimator.step import LENGTH_SCALE, POSE

# m, but for the last: what vectors to the surface, clearances, levers, pushes, moves and lever times move come to
VECTOR, CLEARANCE, LEVER, PUSH, MOVE, SWEEP = 0.02, 0.006, 0.05, 0.015, 0.005, 2e-4
NEAREST, FURTHEST = -3.0, 6.0  # between which clearances are told, in units of CLEARANCE
_TINY = 1e-10  # m^2

# Columns behind the latent state.
_X = ANGLES
_VECTORS = _X + POSE
_LEVER = _VECTORS + 3 * FINGERS * SPHERES
_PUSH, _MOVE, _SWEEP = (_LEVER + 3 * FINGERS * k for k in (1, 2, 3))
_PRESS = _LEVER + 12 * FINGERS
_SLIDE = _PRESS + FINGERS
_GAP = _SLIDE + FINGERS
_HINTS = _GAP + FINGERS * SPHERES
INPUTS = _HINTS + len(FIT_SCALE)


def touch(state: EstimatorState, at: Tensor, vectors: Tensor, seen: Fingers) -> Tensor:
    """The transition's inputs ``(B, n + INPUTS) float32``, each of order one.

    Latent state and the fingers' joints; the pose in 6-D form; vectors to the surface; of every pad its place about the
    object, the push, the move, its moment, and both towards the surface; clearances; the fits.

    Args:
        state: latent ``(B, n)`` without the cell's memory; at: ``(B, 3)`` m, where the fingers are seen from;
        vectors: ``(B, 16, 3)`` m, from the spheres to the surface at the estimate.

    Differentiable once in ``state``, ``at`` and ``vectors``, but through the fits.
    """
    hints = fits(seen.points, vectors, at, seen.push, seen.move) * FIT_SCALE
    return _Touch.apply(state.latent, state.x, state.R, at, vectors, seen, hints)


class _Touch(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        latent: Tensor,
        x: Tensor,
        R: Tensor,
        at: Tensor,
        vectors: Tensor,
        seen: Fingers,
        hints: Tensor,
    ) -> Tensor:
        own = latent.shape[1]
        out = torch.empty(len(x), own + INPUTS)
        out[:, :own] = latent.detach()
        out[:, own : own + ANGLES] = seen.joints
        out[:, own + _HINTS :] = hints
        place, spokes = at.detach().contiguous(), vectors.detach().contiguous()
        told = out.numpy()[:, own:]
        _write(_arrays(x, R, place, spokes, seen.points, seen.push, seen.move), RADII.numpy(), told)
        ctx.own = own
        ctx.save_for_backward(place, spokes, seen.push, seen.move)
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Any, ...]:
        place, vectors, push, move = ctx.saved_tensors
        back = gradient.contiguous()
        found = [torch.empty(len(place), *shape) for shape in ((3,), (3, 3), (3,), vectors.shape[1:])]
        _back(
            _arrays(place, vectors, push, move),
            RADII.numpy(),
            back.numpy()[:, ctx.own :],
            tuple(part.numpy() for part in found),
        )
        return (back[:, : ctx.own], *found, None, None)


def _arrays(*tensors: Tensor) -> tuple[np.ndarray, ...]:
    return tuple(tensor.detach().contiguous().numpy() for tensor in tensors)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _write(given, radii, out):
    """All columns of ``out (B, INPUTS)`` but joints and hints."""
    x, R, at, vectors, points, push, move = given
    for b in range(len(x)):
        row = out[b]
        for k in range(3):
            row[_X + k] = x[b, k] / LENGTH_SCALE
            row[_X + 3 + k], row[_X + 6 + k] = R[b, k, 0], R[b, k, 1]
        for s in range(FINGERS * SPHERES):
            square = _TINY
            for k in range(3):
                square += vectors[b, s, k] ** 2
                row[_VECTORS + 3 * s + k] = vectors[b, s, k] / VECTOR
            gap = (math.sqrt(square) - radii[s]) / CLEARANCE
            row[_GAP + s] = min(max(gap, NEAREST), FURTHEST)
        for f in range(FINGERS):
            s = SPHERES * f + PAD
            v0, v1, v2 = vectors[b, s, 0], vectors[b, s, 1], vectors[b, s, 2]
            l0, l1, l2 = points[b, s, 0] - at[b, 0], points[b, s, 1] - at[b, 1], points[b, s, 2] - at[b, 2]
            m0, m1, m2 = move[b, f, 0], move[b, f, 1], move[b, f, 2]
            p0, p1, p2 = push[b, f, 0], push[b, f, 1], push[b, f, 2]
            far = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2 + _TINY)
            lever, pushed, moved, sweep = _LEVER + 3 * f, _PUSH + 3 * f, _MOVE + 3 * f, _SWEEP + 3 * f
            row[lever], row[lever + 1], row[lever + 2] = l0 / LEVER, l1 / LEVER, l2 / LEVER
            row[pushed], row[pushed + 1], row[pushed + 2] = p0 / PUSH, p1 / PUSH, p2 / PUSH
            row[moved], row[moved + 1], row[moved + 2] = m0 / MOVE, m1 / MOVE, m2 / MOVE
            row[sweep] = (l1 * m2 - l2 * m1) / SWEEP
            row[sweep + 1] = (l2 * m0 - l0 * m2) / SWEEP
            row[sweep + 2] = (l0 * m1 - l1 * m0) / SWEEP
            row[_PRESS + f] = (p0 * v0 + p1 * v1 + p2 * v2) / (far * PUSH)
            row[_SLIDE + f] = (m0 * v0 + m1 * v1 + m2 * v2) / (far * MOVE)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _back(given, radii, gradient, found):
    """Gradients of x, R, at and vectors from that of the columns ``(B, INPUTS)``."""
    at, vectors, push, move = given
    x_back, R_back, at_back, vectors_back = found
    for b in range(len(at)):
        g = gradient[b]
        for k in range(3):
            x_back[b, k] = g[_X + k] / LENGTH_SCALE
            R_back[b, k, 0], R_back[b, k, 1], R_back[b, k, 2] = g[_X + 3 + k], g[_X + 6 + k], 0.0
            at_back[b, k] = 0.0
        for s in range(FINGERS * SPHERES):
            square = _TINY
            for k in range(3):
                square += vectors[b, s, k] ** 2
            far = math.sqrt(square)
            gap = (far - radii[s]) / CLEARANCE
            slope = g[_GAP + s] / (far * CLEARANCE) if NEAREST <= gap <= FURTHEST else 0.0
            for k in range(3):
                vectors_back[b, s, k] = g[_VECTORS + 3 * s + k] / VECTOR + slope * vectors[b, s, k]
        for f in range(FINGERS):
            s = SPHERES * f + PAD
            square, press, slide = _TINY, 0.0, 0.0
            for k in range(3):
                square += vectors[b, s, k] ** 2
                press += push[b, f, k] * vectors[b, s, k]
                slide += move[b, f, k] * vectors[b, s, k]
            far = math.sqrt(square)
            a, c = g[_PRESS + f] / (far * PUSH), g[_SLIDE + f] / (far * MOVE)
            along = (a * press + c * slide) / square
            sweep = _SWEEP + 3 * f
            for k in range(3):
                one, two = (k + 1) % 3, (k + 2) % 3
                vectors_back[b, s, k] += a * push[b, f, k] + c * move[b, f, k] - along * vectors[b, s, k]
                # the lever is the point less ``at``; its gradient through the sweep is move x gradient
                turned = move[b, f, one] * g[sweep + two] - move[b, f, two] * g[sweep + one]
                at_back[b, k] -= g[_LEVER + 3 * f + k] / LEVER + turned / SWEEP
