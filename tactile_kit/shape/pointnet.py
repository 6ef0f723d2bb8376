"""PointNet: surface points in the hand frame, one learned layer, max-pool (section IV-A; Qi et al. 2016).

The paper drops PointNet's input transform, so the orientation stays visible, and uses 256 points and 64 units.
"""

from __future__ import annotations

import numpy as np
import torch

from randomization import stream
from tactile_kit.shape.base import Encoding
from tactile_kit.shape.pose import check_pose
from tactile_kit.shape.tables import MeshTable

POINTS, UNITS = 256, 64


class PointNet(Encoding):
    """Observation (B, 768): 256 surface points, metres, hand frame, xyz of each; 64 features after ``features()``.

    seed: of the sampling stream. All meshes share one draw, so the same mesh holds the same points in every table and
    sizes of one object hold corresponding points.
    """

    name, label, size, observation_size = "pointnet", "PointNet", UNITS, 3 * POINTS

    def __init__(self, meshes: MeshTable, seed: int = 0) -> None:
        super().__init__(meshes)
        draws = stream(seed, "shape", "pointnet").random((POINTS, 3))
        points = torch.from_numpy(
            np.stack([surface_points(meshes.triangles(i), draws) for i in range(len(meshes))])
        )
        self._points = {torch.float32: points.float(), torch.float64: points}

    def __call__(self, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        check_pose(self.meshes, x, R, mesh)
        return (self._points[x.dtype][mesh] @ R.transpose(1, 2) + x[:, None]).flatten(1)

    @staticmethod  # a saved agent has no meshes to make an encoding of
    def features() -> torch.nn.Module:
        return PointFeatures()


class PointFeatures(torch.nn.Module):
    """(B, 768) -> (B, 64): one linear layer shared by all points, then the maximum over points.

    Normalise all points alike, if at all: per-element statistics would break the symmetry between points.
    """

    def __init__(self) -> None:
        super().__init__()
        self.linear = torch.nn.Linear(3, UNITS)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        return self.linear(observation.unflatten(-1, (POINTS, 3))).amax(dim=-2)


def surface_points(corners: np.ndarray, draws: np.ndarray) -> np.ndarray:
    """Points uniform over a surface: corners (F, 3, 3) metres, draws (n, 3) in [0, 1) -> (n, 3) metres."""
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    cumulative = np.cumsum(area)
    chosen = corners[np.searchsorted(cumulative, draws[:, 0] * cumulative[-1], side="right")]
    root = np.sqrt(draws[:, 1])
    weights = np.stack([1 - root, root * (1 - draws[:, 2]), root * draws[:, 2]], axis=1)
    return np.einsum("nk,nkj->nj", weights, chosen)
