"""VecBPS, the paper's encoding: vectors from 64 fixed points to the posed mesh (section III-A, eq. 5)."""

from __future__ import annotations

import torch

from tactile_kit.shape.base import Encoding
from tactile_kit.shape.function import bps_vectors


class VecBPS(Encoding):
    """(B, 192): v_1 ... v_64, metres, hand frame; zero for points inside. Points in the order of basis_points()."""

    name, label, size, observation_size = "vec_bps", "VecBPS", 192, 192
    per_basis_point = 3

    def __call__(self, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        return bps_vectors(self.meshes, x, R, mesh).flatten(1)
