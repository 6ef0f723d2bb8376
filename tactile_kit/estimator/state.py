"""The recurrent state s = (x̂, R̂, l) (paper, section II-D)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor


class EstimatorState(NamedTuple):
    """Estimate and latent state of B environments.

    x: ``(B, 3)`` m, object position; R: ``(B, 3, 3)`` object orientation, both in the hand's world frame;
    latent: ``(B, n)`` whatever the estimator carries beside the pose.
    """

    x: Tensor
    R: Tensor
    latent: Tensor

    def detach(self) -> EstimatorState:
        """The same values outside the computation graph."""
        return EstimatorState(*(part.detach() for part in self))

    def replaced(self, mask: Tensor, other: EstimatorState) -> EstimatorState:
        """``other`` where ``mask`` ``(B,) bool``, this state elsewhere. Neither's gradient leaks into the other."""
        return EstimatorState(
            torch.where(mask[:, None], other.x, self.x),
            torch.where(mask[:, None, None], other.R, self.R),
            torch.where(mask[:, None], other.latent, self.latent),
        )

    def rows(self, index: Tensor | slice) -> EstimatorState:
        """The states of some environments."""
        return EstimatorState(*(part[index] for part in self))
