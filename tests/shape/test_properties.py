"""Equivalences that hold for every mesh and pose."""

from __future__ import annotations

import numpy as np
import torch
from bps_cases import POINTS, hard_shapes, table_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tactile_kit.shape import MeshTable, bps_vectors

SHAPES = hard_shapes()
meshes = st.sampled_from(
    [SHAPES[name] for name in ("box", "l", "notch", "needle", "saddle", "slab", "dense")]
)
offsets = st.tuples(*[st.floats(-0.06, 0.06)] * 3).map(np.array)
seeds = st.integers(0, 2**31)
examples = settings(max_examples=40, deadline=None)
ROW = torch.zeros(1, dtype=torch.int64)


def rotation(seed: int) -> np.ndarray:
    return Rotation.random(rng=np.random.default_rng(seed)).as_matrix()


def encode(mesh: object, x: np.ndarray, R: np.ndarray) -> torch.Tensor:
    table = mesh if isinstance(mesh, MeshTable) else table_of(mesh)
    return bps_vectors(
        table, torch.from_numpy(x)[None], torch.from_numpy(np.ascontiguousarray(R))[None], ROW
    )[0]


def same(first: torch.Tensor, second: torch.Tensor) -> bool:
    """Equal lengths; equal vectors but for points that have two closest ones (at most a few, by symmetry)."""
    lengths = torch.allclose(first.norm(dim=1), second.norm(dim=1), atol=1e-12)
    return lengths and ((first - second).norm(dim=1) < 1e-11).double().mean().item() > 0.8


@given(meshes, offsets, offsets, seeds)
@examples
def test_moving_the_mesh_is_moving_the_pose(
    mesh: object, x: np.ndarray, shift: np.ndarray, seed: int
) -> None:
    R = rotation(seed)
    moved = mesh.copy()
    moved.vertices = mesh.vertices + shift  # apply_translation leaves out shifts of a nanometre
    assert same(encode(moved, x, R), encode(mesh, x + R @ shift, R))


@given(meshes, offsets, seeds, seeds)
@examples
def test_turning_the_mesh_is_turning_the_pose(mesh: object, x: np.ndarray, seed: int, other: int) -> None:
    R, turn = rotation(seed), rotation(other)
    turned = mesh.copy()
    turned.vertices = mesh.vertices @ turn.T
    assert same(encode(turned, x, R), encode(mesh, x, R @ turn))


@given(meshes, offsets, seeds, st.integers(0, 23))
@examples
def test_turning_the_whole_scene_permutes_the_grid(
    mesh: object, x: np.ndarray, seed: int, group: int
) -> None:
    R, turn = rotation(seed), np.rint(Rotation.create_group("O").as_matrix()[group])
    here, there = encode(mesh, x, R), encode(mesh, turn @ x, turn @ R)
    moved = POINTS.numpy() @ turn.T
    order = np.argmin(np.linalg.norm(moved[:, None] - POINTS.numpy(), axis=2), axis=1)
    assert np.allclose(moved, POINTS.numpy()[order])
    assert same(here @ torch.from_numpy(turn).T, there[order])


@given(meshes, offsets, seeds)
@examples
def test_subdividing_or_shuffling_triangles_changes_nothing(mesh: object, x: np.ndarray, seed: int) -> None:
    R, rng = rotation(seed), np.random.default_rng(seed)
    expected = encode(mesh, x, R)
    assert same(encode(mesh.subdivide(), x, R), expected)
    names = rng.permutation(len(mesh.vertices))
    vertices = np.empty_like(mesh.vertices)
    vertices[names] = mesh.vertices
    faces = names[mesh.faces][rng.permutation(len(mesh.faces))]
    faces = np.take_along_axis(faces, (np.arange(3) + rng.integers(3, size=(len(faces), 1))) % 3, axis=1)
    assert same(encode(MeshTable.from_meshes([(vertices, faces)]), x, R), expected)


@given(meshes, offsets, seeds, st.floats(0.2, 5))
@examples
def test_feet_do_not_move_when_the_object_approaches_them(
    mesh: object, x: np.ndarray, seed: int, share: float
) -> None:
    """|v| is 1-Lipschitz in the position: no jump across the medial axis or at the surface."""
    R = rotation(seed)
    step = np.random.default_rng(seed).normal(size=3) * 1e-3 * share
    change = encode(mesh, x + step, R).norm(dim=1) - encode(mesh, x, R).norm(dim=1)
    assert change.abs().max() <= np.linalg.norm(step) + 1e-12
