"""PosRot: the object's pose, without its shape (section IV-A)."""

from __future__ import annotations

import torch

from tactile_kit.shape.base import Encoding
from tactile_kit.shape.pose import check_pose, pose_features


class PosRot(Encoding):
    """(B, 9): x in metres, hand frame, and the first two columns of R."""

    name, label, size, observation_size = "pos_rot", "PosRot", 9, 9
    tells_shape = pose_beside = False
    unitless = slice(3, 9)

    def __call__(self, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        check_pose(self.meshes, x, R, mesh)
        return pose_features(x, R)
