"""The estimator's loss: two distances under zero-mean Normal densities with predicted sigmas (paper, section II-D)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

HALF_LOG_2PI = 0.5 * math.log(2.0 * math.pi)


def shape_distance(truth: Tensor, estimate: Tensor) -> Tensor:
    """d_v: mean absolute difference of basis-point distances ``(..., N_b)`` m: ``(...)`` m.

    Magnitudes, not vectors: they are continuous in the pose, and blind to the object's symmetries.
    """
    return (truth - estimate).abs().mean(-1)


def negative_log_likelihood(distance: Tensor, sigma: Tensor) -> Tensor:
    """-log of the zero-mean Normal density with standard deviation ``sigma`` at ``distance``, elementwise."""
    return 0.5 * (distance / sigma) ** 2 + sigma.log() + HALF_LOG_2PI


def estimator_loss(distance: Tensor, angle: Tensor, sigmas: Tensor) -> Tensor:
    """The paper's loss before averaging (equation 6).

    Args:
        distance: d_v ``(N,)``. Centimetres: both terms, and both sigmas, are then of the order of 0.1 to 1, where
            metres would put σ_v two orders below σ_R at the output of one network. A unit only adds a constant.
        angle: d(R̂, R) ``(N,)`` in rad.
        sigmas: ``(N, 2)``: σ_v in the distance's unit, σ_R in rad.

    Returns:
        Negative log-likelihood ``(N,)``.
    """
    return negative_log_likelihood(torch.stack([distance, angle], dim=1), sigmas).sum(1)
