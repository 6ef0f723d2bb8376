"""Pos: only the object's position (section IV-A)."""

from __future__ import annotations

import torch

from tactile_kit.shape.base import Encoding
from tactile_kit.shape.pose import check_pose


class Pos(Encoding):
    """(B, 3): x, metres, hand frame."""

    name, size, observation_size = "pos", 3, 3
    tells_shape = False

    def __call__(self, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        check_pose(self.meshes, x, R, mesh)
        return x
