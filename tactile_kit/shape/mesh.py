"""Mesh: the pose and, apart from it, the mesh in canonical pose (section IV-A)."""

from __future__ import annotations

import torch

from tactile_kit.shape.base import Encoding
from tactile_kit.shape.function import bps_vectors
from tactile_kit.shape.pose import check_pose, pose_features
from tactile_kit.shape.tables import MeshTable


class Mesh(Encoding):
    """(B, 201): pose (9, as PosRot) and the VecBPS of the mesh at x = 0, R = I (192, metres), constant per mesh."""

    name, label, size, observation_size = "mesh", "Mesh", 201, 201
    pose_beside = False
    unitless = slice(3, 9)

    def __init__(self, meshes: MeshTable) -> None:
        super().__init__(meshes)
        number = len(meshes)
        canonical = bps_vectors(
            meshes,
            torch.zeros(number, 3, dtype=torch.float64),
            torch.eye(3, dtype=torch.float64).repeat(number, 1, 1),
            torch.arange(number),
        ).flatten(1)
        self._canonical = {torch.float32: canonical.float(), torch.float64: canonical}

    def __call__(self, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        check_pose(self.meshes, x, R, mesh)
        return torch.cat([pose_features(x, R), self._canonical[x.dtype][mesh]], dim=1)
