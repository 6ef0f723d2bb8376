"""Closest-point vectors against the twin: distances, signs, feet."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from bps_cases import assert_exact, hard_shapes, random_poses, reference, table_of, touching_poses

import object_sets
from tactile_kit.shape import MeshTable, bps_vectors

TOLERANCE = {torch.float32: 1e-7, torch.float64: 1e-12}
SHAPES = hard_shapes()
PRECISIONS = pytest.mark.parametrize("dtype", [torch.float32, torch.float64])


def check(table: MeshTable, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor, dtype: torch.dtype) -> int:
    # The twin gets the rounded pose: rounding is the caller's, not the kernel's.
    x, R = x.to(dtype), R.to(dtype)
    return assert_exact(table, bps_vectors(table, x, R, mesh), x, R, mesh, TOLERANCE[dtype])


@PRECISIONS
@pytest.mark.parametrize("name", SHAPES)
def test_hard_shapes(name: str, dtype: torch.dtype) -> None:
    rng = np.random.default_rng(1)
    table = table_of(SHAPES[name])
    x, R = random_poses(rng, 30)
    touching_x, touching_R = touching_poses(rng, table.triangles(0), 60)
    mesh = torch.zeros(90, dtype=torch.int64)
    check(table, torch.cat([x, touching_x]), torch.cat([R, touching_R]), mesh, dtype)


@pytest.mark.slow
@pytest.mark.parametrize("dtype,per_mesh", [(torch.float32, 50), (torch.float64, 10)])
def test_all_objects_nominal_and_scaled(dtype: torch.dtype, per_mesh: int) -> None:
    """At least 100,000 float32 queries; the twin is slow, so there are fewer in float64."""
    rng = np.random.default_rng(2)
    objects = list(object_sets.load("all"))
    assert len(objects) == 16
    # half of them at per-axis random extents, as in training
    meshes = objects + [item.with_extents(rng.uniform(0.045, 0.09, 3)) for item in objects]
    table = MeshTable.from_meshes([(item.vertices, item.faces) for item in meshes])
    queries, inside = 0, 0
    for index in range(len(table)):
        x, R = random_poses(rng, per_mesh // 2)
        touching_x, touching_R = touching_poses(rng, table.triangles(index), per_mesh - per_mesh // 2)
        mesh = torch.full((per_mesh,), index)
        inside += check(table, torch.cat([x, touching_x]), torch.cat([R, touching_R]), mesh, dtype)
        queries += per_mesh * 64
    assert queries >= (100_000 if dtype == torch.float32 else 20_000)
    assert 0.02 < inside / queries < 0.5


@PRECISIONS
@pytest.mark.parametrize("distance", [0.5, 5.0])
def test_far_away(distance: float, dtype: torch.dtype) -> None:
    table = table_of(SHAPES["l"])
    x, R = random_poses(np.random.default_rng(3), 20)
    x, R = (x / torch.linalg.vector_norm(x, dim=1, keepdim=True) * distance).to(dtype), R.to(dtype)
    mesh = torch.zeros(20, dtype=torch.int64)
    expected = torch.linalg.vector_norm(reference(table, x.double(), R.double(), mesh), dim=-1)
    lengths = torch.linalg.vector_norm(bps_vectors(table, x, R, mesh), dim=-1)
    # float32 resolves 1e-7 of the distance, no better
    assert torch.allclose(lengths.double(), expected, rtol=4e-7 if dtype == torch.float32 else 1e-14, atol=0)
    assert (lengths > 0).all()


@PRECISIONS
def test_all_points_inside(dtype: torch.dtype) -> None:
    mesh = SHAPES["box"].copy().apply_scale(10)
    vectors = bps_vectors(
        table_of(mesh), torch.zeros(1, 3, dtype=dtype), torch.eye(3, dtype=dtype)[None], torch.zeros(1).long()
    )
    assert (vectors == 0).all()


@PRECISIONS
def test_cube_by_hand(dtype: torch.dtype) -> None:
    """Half extents 6 cm: corner points miss by 1 cm on each axis; the inner 2.33 cm grid is inside."""
    mesh = SHAPES["box"].copy()
    mesh.apply_scale(0.12 / mesh.extents)
    eye = torch.eye(3, dtype=dtype)[None]
    vectors = bps_vectors(table_of(mesh), torch.zeros(1, 3, dtype=dtype), eye, torch.zeros(1).long())
    grid = vectors.reshape(4, 4, 4, 3)
    assert torch.allclose(grid[0, 0, 0], torch.full((3,), 0.01, dtype=dtype), atol=1e-8)
    assert torch.allclose(grid[3, 1, 2], torch.tensor([-0.01, 0, 0], dtype=dtype), atol=1e-8)
    assert (grid[1:3, 1:3, 1:3] == 0).all()


@PRECISIONS
def test_rows_do_not_depend_on_the_batch(dtype: torch.dtype) -> None:
    names = ["box", "notch", "saddle", "dense", "slab"]
    table = table_of(*(SHAPES[name] for name in names))
    x, R = (t.to(dtype) for t in random_poses(np.random.default_rng(4), 40))
    mesh = torch.arange(40) % len(names)
    together = bps_vectors(table, x, R, mesh)
    for row in range(40):
        alone = bps_vectors(
            table_of(SHAPES[names[row % len(names)]]), x[row : row + 1], R[row : row + 1], mesh[:1]
        )
        assert torch.equal(together[row], alone[0])


def test_strided_inputs() -> None:
    table = table_of(SHAPES["l"], SHAPES["box"])
    x, R = random_poses(np.random.default_rng(5), 12)
    mesh = torch.arange(12) % 2
    expected = bps_vectors(table, x, R, mesh)
    assert not (transposed := R.transpose(1, 2).contiguous().transpose(1, 2)).is_contiguous()
    assert torch.equal(bps_vectors(table, x.T.contiguous().T, transposed, mesh), expected)
    assert torch.equal(bps_vectors(table, x[::2], R[::2], mesh[::2]), expected[::2])
