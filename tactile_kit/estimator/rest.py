"""An object that never moves: what any estimator has to be better than."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from tactile_kit.estimator.state import EstimatorState


class Rest:
    """Believes for ever what it was told at the start: R̂ = R₀, at the nominal centre. Sigmas are one unit, one rad."""

    def initial(self, R0: Tensor) -> EstimatorState:
        """R0 ``(B, 3, 3)``."""
        return EstimatorState(R0.new_zeros(len(R0), 3), R0, R0.new_zeros(len(R0), 0))

    def __call__(self, state: EstimatorState, z: Tensor, encoding: Any, mesh: Tensor) -> EstimatorState:
        """The state as it is, whatever is felt."""
        return state

    def sigmas(self, state: EstimatorState) -> Tensor:
        """``(B, 2)``."""
        return torch.ones(len(state.x), 2)
