"""Diagonal Gaussians of one sigma an action: density, entropy, divergence, and the step size that follows it."""

from __future__ import annotations

_HALF_LOG_2PI = 0.918938533204673


def log_density(action, mean, log_std):
    """Log density ``(B,)`` of actions ``(B, A)`` under a diagonal Gaussian, log sigma ``(A,)``."""
    return (-0.5 * ((action - mean) * (-log_std).exp()).square() - log_std - _HALF_LOG_2PI).sum(1)


def divergence_of(mean, log_std, old_mean, old_log_std):
    """Mean KL(old || new) of diagonal Gaussians, means ``(B, A)``, log sigmas ``(A,)``."""
    ratio = (2.0 * (old_log_std - log_std)).exp()
    distance = ((old_mean - mean) * (-log_std).exp()).square()
    return (log_std - old_log_std + 0.5 * (ratio + distance - 1.0)).sum(1).mean()


def entropy_of(log_std):
    """Entropy of a diagonal Gaussian, log sigma ``(A,)``."""
    return (log_std + 0.5 + _HALF_LOG_2PI).sum()


def adapted_rate(rate: float, divergence: float, threshold: float, bounds: tuple[float, float]) -> float:
    """rl_games' rule: slower by 1.5 above twice the threshold, faster by 1.5 below half of it, within bounds."""
    if divergence > 2.0 * threshold:
        return max(rate / 1.5, bounds[0])
    if divergence < 0.5 * threshold:
        return min(rate * 1.5, bounds[1])
    return rate
