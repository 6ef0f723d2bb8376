"""The compiled kernel as a differentiable torch function."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch.autograd.function import once_differentiable

from tactile_kit.shape import gradients, kernels
from tactile_kit.shape.tables import MeshTable


def basis_points() -> np.ndarray:
    """The paper's basis points: 4^3 grid over [-0.07, 0.07]^3 (section III-A). (64, 3) float64, metres, hand frame."""
    axis = np.linspace(-0.07, 0.07, 4)
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)


_LANES = {
    torch.float32: np.ascontiguousarray(basis_points().T, np.float32),
    torch.float64: basis_points().T.copy(),
}
_UNSAVED = {dtype: np.zeros((1, kernels.K, 4), lanes.dtype) for dtype, lanes in _LANES.items()}


class PoseError(ValueError):
    """Poses that cannot be encoded; the message names the argument, what it is and what is allowed."""


def bps_vectors(table: MeshTable, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
    """Vectors from each basis point to the closest surface point of the posed mesh, zero inside (paper eq. 4).

    x (B, 3), R (B, 3, 3): object pose, metres, hand frame, float32 or float64 on the CPU; mesh (B,) int64: index into
    the table. Returns (B, 64, 3) of the same dtype, metres, hand frame; differentiable once in x and R (R's gradient
    has meaning along rotations only). B may be 0.

    Raises PoseError for wrong shapes, dtypes or devices, poses that are not finite, positions beyond 100 m, matrices
    that are no rotation (by more than 1e-3), and mesh indices out of range.
    """
    dtype = x.dtype
    if dtype not in _LANES or R.dtype != dtype or mesh.dtype != torch.int64 or x.ndim != 2:
        _refuse(x, R, mesh)
    size = x.shape[0]
    if (
        x.shape[1] != 3
        or R.shape != (size, 3, 3)
        or mesh.shape != (size,)
        or not (x.is_cpu and R.is_cpu and mesh.is_cpu)
    ):
        _refuse(x, R, mesh)
    if torch.is_grad_enabled() and (x.requires_grad or R.requires_grad):
        return _Vectors.apply(x, R, mesh, table)
    return _forward(x.detach(), R.detach(), mesh, table, None)


class _Vectors(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor, table: MeshTable
    ) -> torch.Tensor:
        x, R = x.detach(), R.detach()
        unit = torch.empty((x.shape[0], kernels.K, 4), dtype=x.dtype)
        vectors = _forward(x, R, mesh, table, unit)
        # The alias shares the version counter (edits in place are still found out) but unpacks 15 us sooner than
        # an output, which autograd has to bind to its graph again.
        ctx.save_for_backward(x, R, vectors.detach(), unit)
        return vectors

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, None, None]:
        x, R, vectors, unit = ctx.saved_tensors
        x_gradient, R_gradient = torch.empty(x.shape, dtype=x.dtype), torch.empty(R.shape, dtype=R.dtype)
        gradients.backward(
            _LANES[x.dtype],
            x.contiguous().numpy(),
            R.contiguous().numpy(),
            vectors.numpy(),
            unit.numpy(),
            # sum() and mean() hand out expanded gradients of stride 0
            gradient.contiguous().numpy(),
            x_gradient.numpy(),
            R_gradient.numpy(),
        )
        return x_gradient, R_gradient, None, None


def _forward(
    x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor, table: MeshTable, unit: torch.Tensor | None
) -> torch.Tensor:
    dtype = x.dtype
    lanes = _LANES[dtype]
    vectors = torch.empty((x.shape[0], kernels.K, 3), dtype=dtype)
    status, row = kernels.forward(
        lanes,
        x.contiguous().numpy(),
        R.contiguous().numpy(),
        mesh.contiguous().numpy(),
        *table.arrays(lanes.dtype),
        vectors.numpy(),
        _UNSAVED[dtype] if unit is None else unit.numpy(),
        unit is not None,
    )
    if status != kernels.OK:
        refuse_row(status, row, x, R, mesh, len(table))
    return vectors


def _refuse(x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> None:
    for name, tensor in (("x", x), ("R", R), ("mesh", mesh)):
        if not tensor.is_cpu:
            raise PoseError(f"{name} is on {tensor.device}, expected the CPU")
    if x.dtype not in _LANES or x.dtype != R.dtype:
        raise PoseError(f"x is {x.dtype} and R is {R.dtype}, expected both float32 or both float64")
    if mesh.dtype != torch.int64:
        raise PoseError(f"mesh is {mesh.dtype}, expected torch.int64")
    raise PoseError(
        f"x is {tuple(x.shape)}, R {tuple(R.shape)}, mesh {tuple(mesh.shape)}, expected (B, 3), (B, 3, 3) and (B,)"
    )


def refuse_row(
    status: int, row: int, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor, meshes: int
) -> None:
    if status == kernels.BAD_MESH:
        raise PoseError(f"mesh[{row}] is {int(mesh[row])}, allowed 0..{meshes - 1}")
    if status == kernels.BAD_POSITION:
        raise PoseError(
            f"x[{row}] is {x[row].tolist()}, expected finite metres within +-{kernels.MAX_POSITION}"
        )
    raise PoseError(f"R[{row}] is {R[row].tolist()}, no rotation matrix within {kernels.MAX_SKEW}")
