"""The state after a cell's residuals, within bounds, as one compiled, differentiable operation."""

from __future__ import annotations

from typing import Any

import numba
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from tactile_kit.estimator import turn
from tactile_kit.estimator.state import EstimatorState

# Fixed constants, because the sizes are known before the first roll-out and a running normalisation would move the
# recurrence under its feet. The object wanders a few centimetres, the size of most basis-point vectors.
LENGTH_SCALE = 0.03
POSE = 9  # numbers of a pose: position, and rotation in 6-D form
# What an object does in one step of 0.1 s (half a turn takes some 2.5 s).
POSITION_STEP, ROTATION_STEP = 0.01, 0.1
# No estimate may run away: an object 10 cm off is dropped (m, every axis), and turns by 0.1 rad a step.
FARTHEST, LARGEST_TURN, LARGEST_LATENT = 0.12, 1.5, 30.0


def moved(state: EstimatorState, residual: Tensor) -> EstimatorState:
    """The state after residuals ``(B, n + 6)`` of latent state, position and orientation: R̂ <- exp(δr) R̂.

    Differentiable once; where a bound holds, not through it.
    """
    return EstimatorState(*_Moved.apply(state.x, state.R, state.latent, residual))


class _Moved(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, R: Tensor, latent: Tensor, residual: Tensor) -> tuple[Tensor, ...]:
        given = [part.detach().contiguous() for part in (x, R, latent, residual)]
        after = [torch.empty_like(part) for part in given[:3]]
        r = torch.empty_like(given[0])
        _bounded(*(part.numpy() for part in (given[0], given[2], given[3], after[0], after[2], r)))
        turn.forward(given[1].numpy(), r.numpy(), after[1].numpy())
        ctx.save_for_backward(*given, r, after[1])
        return tuple(after)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, ...]:
        x, _, latent, residual, r, R_after = ctx.saved_tensors
        x_back, R_back, latent_back = (part.contiguous().clone() for part in gradients)
        r_back, back = torch.empty_like(r), torch.empty_like(residual)
        turn.backward(
            r.numpy(), R_after.numpy(), gradients[1].contiguous().numpy(), R_back.numpy(), r_back.numpy()
        )
        arrays = (x, latent, residual, r_back, x_back, latent_back, back)
        _bounded_backward(*(part.numpy() for part in arrays))
        return x_back, R_back, latent_back, back


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _bounded(x, latent, residual, x_after, latent_after, r):
    """Position, latent state and the rotation vector ``r (B, 3)`` rad after the residuals."""
    own = latent.shape[1]
    for b in range(len(x)):
        for k in range(own):
            latent_after[b, k] = min(max(latent[b, k] + residual[b, k], -LARGEST_LATENT), LARGEST_LATENT)
        for k in range(3):
            x_after[b, k] = min(max(x[b, k] + POSITION_STEP * residual[b, own + k], -FARTHEST), FARTHEST)
            r[b, k] = min(max(ROTATION_STEP * residual[b, own + 3 + k], -LARGEST_TURN), LARGEST_TURN)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _bounded_backward(x, latent, residual, r_back, x_back, latent_back, back):
    """Gradient ``back`` of the residuals; those of x and latent state lose what the bounds held."""
    own = latent.shape[1]
    for b in range(len(x)):
        for k in range(own):
            if abs(latent[b, k] + residual[b, k]) > LARGEST_LATENT:
                latent_back[b, k] = 0.0
            back[b, k] = latent_back[b, k]
        for k in range(3):
            if abs(x[b, k] + POSITION_STEP * residual[b, own + k]) > FARTHEST:
                x_back[b, k] = 0.0
            back[b, own + k] = POSITION_STEP * x_back[b, k]
            held = abs(ROTATION_STEP * residual[b, own + 3 + k]) > LARGEST_TURN
            back[b, own + 3 + k] = 0.0 if held else ROTATION_STEP * r_back[b, k]
