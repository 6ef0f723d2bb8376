"""The unscented Kalman filter of filterpy, for a batch of states at once.

filterpy's own filter takes one state and one Python call a sigma point; here all points of all states go through a
function together. Sigma points and weights are filterpy's, the algebra is that of its ``UnscentedKalmanFilter``, which
the tests hold it against.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from filterpy.kalman import MerweScaledSigmaPoints
from torch import Tensor

from tactile_kit.errors import EstimatorError

JITTER = 1e-12  # on the diagonal: keeps rounding from making a covariance singular


class Unscented:
    """Prediction and correction of means ``(B, n)`` and covariances ``(B, n, n)``, float64.

    Args:
        n: size of a state. alpha, beta, kappa: as of filterpy's ``MerweScaledSigmaPoints``.

    Raises:
        EstimatorError: the points would fall together: alpha² (n + kappa) is not above zero.
    """

    def __init__(self, n: int, alpha: float, beta: float, kappa: float) -> None:
        self.scale = alpha**2 * (n + kappa)
        if self.scale <= 0:
            raise EstimatorError(f"alpha² (n + kappa) = {self.scale}, allowed: > 0")
        rule = MerweScaledSigmaPoints(n, alpha, beta, kappa)
        self.mean, self.spread = torch.from_numpy(rule.Wm), torch.from_numpy(rule.Wc)

    def points(self, x: Tensor, P: Tensor) -> Tensor:
        """Sigma points ``(2 n + 1, B, n)``, the mean first."""
        columns = torch.linalg.cholesky(self.scale * P).permute(2, 0, 1)
        return torch.cat([x[None], x + columns, x - columns])

    def predict(
        self, x: Tensor, P: Tensor, f: Callable[[Tensor], Tensor], Q: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Mean and covariance after ``f``, which takes and gives points ``(2 n + 1, B, n)``; Q ``(n, n)`` its noise."""
        moved = f(self.points(x, P))
        mean = torch.einsum("p,pbn->bn", self.mean, moved)
        off = moved - mean
        return mean, _symmetric(torch.einsum("p,pbi,pbj->bij", self.spread, off, off) + Q)

    def update(self, x: Tensor, P: Tensor, h: Callable[[Tensor], Tensor], R: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and covariance after measuring zero of ``h``: points ``(2 n + 1, B, n)`` to ``(2 n + 1, B, m)``.

        R ``(m, m)`` is the measurements' noise.
        """
        points = self.points(x, P)
        seen = h(points)
        expected = torch.einsum("p,pbm->bm", self.mean, seen)
        off = seen - expected
        S = torch.einsum("p,pbi,pbj->bij", self.spread, off, off) + R
        cross = torch.einsum("p,pbi,pbj->bij", self.spread, points - x, off)
        gain = torch.linalg.solve(S, cross, left=False)
        mean = x - (gain @ expected[..., None])[..., 0]
        return mean, _symmetric(P - gain @ S @ gain.transpose(1, 2))


def _symmetric(P: Tensor) -> Tensor:
    return 0.5 * (P + P.transpose(1, 2)) + JITTER * torch.eye(P.shape[-1], dtype=P.dtype)
