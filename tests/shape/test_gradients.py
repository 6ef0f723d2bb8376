"""The closed-form gradient against central differences and against autograd through the twin."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from bps_cases import hard_shapes, random_poses, reference, table_of

import object_sets
from tactile_kit.shape import BPS, MeshTable, bps_vectors

SHAPES = hard_shapes()


def exponential(omega: torch.Tensor) -> torch.Tensor:
    """Rotation matrices (B, 3, 3) of rotation vectors (B, 3)."""
    zero = torch.zeros_like(omega[:, 0])
    a, b, c = omega.unbind(1)
    skew = torch.stack([zero, -c, b, c, zero, -a, -b, a, zero], dim=1).reshape(-1, 3, 3)
    return torch.matrix_exp(skew)


def jacobian(table: MeshTable, x: torch.Tensor, R: torch.Tensor, index: int) -> torch.Tensor:
    """d v / d (x, rotation vector on the left) at one pose: (64, 3, 6), one backward pass a row."""
    rows = 192
    moved = torch.zeros(rows, 6, dtype=torch.float64, requires_grad=True)
    vectors = bps_vectors(table, x + moved[:, :3], exponential(moved[:, 3:]) @ R, torch.full((rows,), index))
    (gradient,) = torch.autograd.grad(
        vectors, moved, torch.eye(rows, dtype=torch.float64).reshape(rows, 64, 3)
    )
    return gradient.reshape(64, 3, 6)


def check_pose(table: MeshTable, x: torch.Tensor, R: torch.Tensor, index: int, step: float = 1e-6) -> int:
    """Compare all six directions; returns how many points were skipped because their nearest feature changes there."""
    derivative = jacobian(table, x, R, index)
    skipped = torch.zeros(64, dtype=torch.bool)
    numeric = []
    for axis in torch.eye(6, dtype=torch.float64) * step:
        ends = []
        for sign in (1.0, -1.0):
            at = (x + sign * axis[:3], (exponential(sign * axis[None, 3:]) @ R)[0])
            ends.append(bps_vectors(table, at[0][None], at[1][None], torch.tensor([index]))[0])
            # On another feature (across the medial axis, over an edge) the derivative itself jumps.
            skipped |= (jacobian(table, *at, index) - derivative).abs().amax(dim=(1, 2)) > 1e-3
        numeric.append((ends[0] - ends[1]) / (2 * step))
    error = (torch.stack(numeric, dim=-1) - derivative).abs().amax(dim=(1, 2))
    assert error[~skipped].max() <= 1e-6
    return int(skipped.sum())


@pytest.mark.parametrize("name", SHAPES)
def test_central_differences(name: str) -> None:
    rng = np.random.default_rng(6)
    table = table_of(SHAPES[name])
    x, R = random_poses(rng, 6)
    skipped = sum(check_pose(table, *pose, 0) for pose in zip(x, R, strict=True))
    assert skipped <= 6 * 64 * 0.02


def test_central_differences_on_all_objects() -> None:
    rng = np.random.default_rng(7)
    objects = object_sets.load("all")
    table = MeshTable.from_meshes([(item.vertices, item.faces) for item in objects])
    x, R = random_poses(rng, 3 * len(objects))
    skipped = sum(
        check_pose(table, *pose, row % len(objects)) for row, pose in enumerate(zip(x, R, strict=True))
    )
    assert skipped <= len(x) * 64 * 0.02


@pytest.mark.parametrize("dtype,tolerance,share", [(torch.float32, 2e-4, 0.85), (torch.float64, 1e-10, 1.0)])
def test_twin_gradient(dtype: torch.dtype, tolerance: float, share: float) -> None:
    """The rows of a mixed batch have the gradients that autograd finds through the twin.

    In float32 a row may hold a point so near to a change of feature that rounding decides on which side it falls.
    """
    names = ["box", "notch", "l", "cylinder", "wedge"]
    table = table_of(*(SHAPES[name] for name in names))
    rng = np.random.default_rng(8)
    x, R = (t.to(dtype) for t in random_poses(rng, 25))
    mesh = torch.arange(25) % len(names)
    weights = torch.from_numpy(rng.normal(size=(25, 64, 3)))
    found = []
    for encode, kind in ((bps_vectors, dtype), (reference, torch.float64)):
        at = x.to(kind).requires_grad_()
        omega = torch.zeros(25, 3, dtype=kind, requires_grad=True)
        vectors = encode(table, at, exponential(omega) @ R.to(kind), mesh)
        found.append(torch.cat(torch.autograd.grad((vectors * weights.to(kind)).sum(), (at, omega)), dim=1))
    close = torch.isclose(found[0].double(), found[1], rtol=tolerance, atol=tolerance * 10).all(dim=1)
    assert close.double().mean() >= share


def test_gradcheck() -> None:
    table = table_of(SHAPES["notch"])
    x, R = random_poses(np.random.default_rng(9), 2)
    omega = torch.zeros(2, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(
        lambda a, b: bps_vectors(table, a, exponential(b) @ R, torch.zeros(2, dtype=torch.int64)),
        (x.requires_grad_(), omega),
        eps=1e-7,
        atol=1e-6,
    )


def test_inside_points_have_zero_gradient_and_no_nan() -> None:
    mesh = SHAPES["box"].copy().apply_scale(10)
    x = torch.zeros(3, 3, requires_grad=True)
    lengths = BPS(table_of(mesh))(x, torch.eye(3).repeat(3, 1, 1), torch.zeros(3, dtype=torch.int64))
    lengths.sum().backward()
    assert torch.equal(x.grad, torch.zeros(3, 3))


def test_expanded_gradients_and_single_inputs() -> None:
    table = table_of(SHAPES["l"])
    x, R = random_poses(np.random.default_rng(10), 5)
    mesh = torch.zeros(5, dtype=torch.int64)
    full = []
    for x_wanted, R_wanted in ((True, True), (True, False), (False, True)):
        a, b = x.clone().requires_grad_(x_wanted), R.clone().requires_grad_(R_wanted)
        bps_vectors(table, a, b, mesh).sum().backward()  # hands out a gradient of stride 0
        full.append((a.grad, b.grad))
    weighted = x.clone().requires_grad_()
    bps_vectors(table, weighted, R, mesh).backward(torch.ones(5, 64, 3, dtype=torch.float64))
    assert torch.equal(full[0][0], weighted.grad) and torch.equal(full[0][0], full[1][0])
    assert full[1][1] is None and torch.equal(full[0][1], full[2][1])


def test_no_second_derivative() -> None:
    x, R = random_poses(np.random.default_rng(11), 1)
    x.requires_grad_()
    vectors = bps_vectors(table_of(SHAPES["box"]), x, R, torch.zeros(1, dtype=torch.int64))
    (gradient,) = torch.autograd.grad((vectors**2).sum(), x, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.sum().backward()
