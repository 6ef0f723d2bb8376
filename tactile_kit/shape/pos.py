"""Pos: only the object's position (section IV-A)."""

from __future__ import annotations

import torch

from tactile_kit.shape.base import Encoding
from tactile_kit.shape.pose import check_pose


class Pos(Encoding):
    """(B, 3): x, metres, hand frame."""

    name, label, size, observation_size = "pos", "Pos", 3, 3
    tells_shape = pose_beside = False

    def __call__(self, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        check_pose(self.meshes, x, R, mesh)
        return x
