"""BPS: only the lengths of the basis point vectors (section IV-A)."""

from __future__ import annotations

import torch

from tactile_kit.shape.base import Encoding
from tactile_kit.shape.function import bps_vectors


class BPS(Encoding):
    """(B, 64): |v_k|, metres; zero for points inside, where the gradient is zero too."""

    name, label, size, observation_size = "bps", "BPS", 64, 64
    per_basis_point = 1

    def __call__(self, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        # vector_norm's gradient at a zero vector is zero; that of sqrt(sum) would be NaN
        return torch.linalg.vector_norm(bps_vectors(self.meshes, x, R, mesh), dim=-1)
