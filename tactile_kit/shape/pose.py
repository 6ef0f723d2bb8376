"""The pose itself as an encoding, and its checks."""

from __future__ import annotations

import torch

from tactile_kit.shape.function import PoseError
from tactile_kit.shape.tables import MeshTable


def pose_features(x: torch.Tensor, R: torch.Tensor) -> torch.Tensor:
    """Position and 6-D rotation (first column of R, then its second): (B, 9), metres and unit-less."""
    return torch.cat([x, R[:, :, 0], R[:, :, 1]], dim=1)


def check_pose(table: MeshTable, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> None:
    """Shapes and dtypes as every encoding wants them, so that a wrong call fails under each. Raises PoseError."""
    size = len(x)
    if x.shape != (size, 3) or R.shape != (size, 3, 3) or mesh.shape != (size,):
        raise PoseError(
            f"x is {tuple(x.shape)}, R {tuple(R.shape)}, mesh {tuple(mesh.shape)}, expected (B, 3), (B, 3, 3) and (B,)"
        )
    if x.dtype not in (torch.float32, torch.float64) or R.dtype != x.dtype:
        raise PoseError(f"x is {x.dtype} and R is {R.dtype}, expected both float32 or both float64")
    if mesh.dtype != torch.int64:
        raise PoseError(f"mesh is {mesh.dtype}, expected torch.int64")
    if size and not 0 <= int(mesh.min()) <= int(mesh.max()) < len(table):
        raise PoseError(f"mesh holds {int(mesh.min())}..{int(mesh.max())}, allowed 0..{len(table) - 1}")
