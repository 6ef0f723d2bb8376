"""The estimator's loss: two distances under zero-mean Normal densities with predicted sigmas (paper, section II-D)."""

from __future__ import annotations

import math

from torch import Tensor

from tactile_kit.estimator import so3

HALF_LOG_2PI = 0.5 * math.log(2.0 * math.pi)


def shape_distance(truth: Tensor, estimate: Tensor) -> Tensor:
    """d_v: mean absolute difference of basis-point distances ``(..., N_b)`` m: ``(...)`` m.

    Magnitudes, not vectors: they are continuous in the pose, and blind to the object's symmetries.
    """
    return (truth - estimate).abs().mean(-1)


def negative_log_likelihood(distance: Tensor, sigma: Tensor) -> Tensor:
    """-log of the zero-mean Normal density with standard deviation ``sigma`` at ``distance``, elementwise."""
    return 0.5 * (distance / sigma) ** 2 + sigma.log() + HALF_LOG_2PI


def estimator_loss(
    truth: Tensor, estimate: Tensor, R: Tensor, R_hat: Tensor, sigmas: Tensor, unit: float
) -> tuple[Tensor, Tensor, Tensor]:
    """The paper's loss before averaging.

    Args:
        truth, estimate: basis-point distances ``(..., N_b)`` m at the true and at the estimated pose.
        R, R_hat: true and estimated orientation ``(..., 3, 3)``.
        sigmas: ``(..., 2)``: σ_v in ``unit``, σ_R in rad.
        unit: m. d_v enters in this unit: with centimetres both terms, and both sigmas, are of the order of 0.1
            to 1, where metres would put σ_v two orders below σ_R at the output of one network. A unit only adds
            a constant to the likelihood.

    Returns:
        Negative log-likelihood ``(...)``, d_v ``(...)`` in ``unit``, angle ``(...)`` in rad.
    """
    distance = shape_distance(truth, estimate) / unit
    angle = so3.geodesic(R_hat, R)
    loss = negative_log_likelihood(distance, sigmas[..., 0]) + negative_log_likelihood(angle, sigmas[..., 1])
    return loss, distance, angle


def magnitudes(vectors: Tensor) -> Tensor:
    """Lengths of flattened basis-point vectors ``(..., 3 N_b)``: ``(..., N_b)``; zero gradient at zero vectors."""
    return so3.safe_norm(vectors.unflatten(-1, (-1, 3)))
