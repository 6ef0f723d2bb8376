"""None: no object information at all (section IV-A)."""

from __future__ import annotations

import torch

from tactile_kit.shape.base import Encoding
from tactile_kit.shape.pose import check_pose


class NoShape(Encoding):
    """(B, 0)."""

    name, label, size, observation_size = "none", "None", 0, 0
    tells_shape = pose_beside = False

    def __call__(self, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        check_pose(self.meshes, x, R, mesh)
        return x[:, :0]
