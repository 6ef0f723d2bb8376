"""Closest-point vectors from points that move with the hand: basis points of the paper's kind, but a pose's own."""

from __future__ import annotations

from typing import Any

import torch
from torch.autograd.function import once_differentiable

from tactile_kit.shape import gradients, kernels
from tactile_kit.shape.function import refuse_row
from tactile_kit.shape.tables import MeshTable

POINTS = kernels.M


def surface_vectors(
    table: MeshTable, x: torch.Tensor, R: torch.Tensor, points: torch.Tensor, mesh: torch.Tensor
) -> torch.Tensor:
    """Vectors from each point to the closest surface point of the posed mesh, zero inside (paper eq. 4).

    x (B, 3), R (B, 3, 3), mesh (B,) int64 as for ``function.bps_vectors``, points (B, 16, 3) metres, hand frame; all
    float32 or all float64, on the CPU. Returns (B, 16, 3) metres, hand frame; differentiable once in x and R, not in
    the points. Raises PoseError for poses and meshes that ``bps_vectors`` refuses.
    """
    lanes = points.detach().transpose(1, 2).contiguous()
    return _Vectors.apply(x, R, lanes, mesh, table)


class _Vectors(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, x: torch.Tensor, R: torch.Tensor, lanes: torch.Tensor, mesh: torch.Tensor, table: MeshTable
    ) -> torch.Tensor:
        x, R = x.detach().contiguous(), R.detach().contiguous()
        vectors = torch.empty((len(x), POINTS, 3), dtype=x.dtype)
        unit = torch.empty((len(x), POINTS, 4), dtype=x.dtype)
        status, row = kernels.forward_moving(
            lanes.numpy(),
            x.numpy(),
            R.numpy(),
            mesh.contiguous().numpy(),
            *table.arrays(x.numpy().dtype),
            vectors.numpy(),
            unit.numpy(),
            True,
        )
        if status != kernels.OK:
            refuse_row(status, row, x, R, mesh, len(table))
        ctx.save_for_backward(x, R, lanes, vectors.detach(), unit)
        return vectors

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[Any, ...]:
        x, R, lanes, vectors, unit = ctx.saved_tensors
        x_gradient, R_gradient = torch.empty_like(x), torch.empty_like(R)
        gradients.backward_moving(
            lanes.numpy(),
            x.numpy(),
            R.numpy(),
            vectors.numpy(),
            unit.numpy(),
            gradient.contiguous().numpy(),
            x_gradient.numpy(),
            R_gradient.numpy(),
        )
        return x_gradient, R_gradient, None, None, None
