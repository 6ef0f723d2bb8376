"""What MeshTable accepts, and what it refuses in which words."""

from __future__ import annotations

import time

import numpy as np
import pytest
import torch
import trimesh
from bps_cases import hard_shapes, random_poses, table_of

import object_sets
from tactile_kit.shape import MeshError, MeshTable, bps_vectors

BOX = trimesh.creation.box((0.05, 0.06, 0.07))
GOOD = (BOX.vertices, BOX.faces)


def refused(vertices: object, faces: object, match: str) -> None:
    """The defect is named, and so is the mesh (here the second)."""
    with pytest.raises(MeshError, match="mesh 1: .*" + match) as error:
        MeshTable.from_meshes([GOOD, (vertices, faces)])
    assert isinstance(error.value, ValueError)


def test_refuses_open_mesh() -> None:
    refused(BOX.vertices, BOX.faces[1:], "not watertight, 3 edges")


def test_refuses_inward_mesh() -> None:
    refused(BOX.vertices, BOX.faces[:, ::-1], "signed volume -2.1.*outward")
    refused(BOX.vertices * [-1, 1, 1], BOX.faces, "signed volume")


def test_refuses_one_flipped_triangle() -> None:
    faces = BOX.faces.copy()
    faces[4] = faces[4, ::-1]
    refused(BOX.vertices, faces, "inconsistent winding")


def test_two_boxes_along_an_edge() -> None:
    """With indices of their own each is closed, and distances are those of the nearer one; with common ones refused."""
    other = BOX.copy().apply_translation((0.05, 0.06, 0))
    both = (np.concatenate([BOX.vertices, other.vertices]), np.concatenate([BOX.faces, other.faces + 8]))
    x, R = random_poses(np.random.default_rng(14), 20)
    rows = torch.zeros(20, dtype=torch.int64)
    found = bps_vectors(MeshTable.from_meshes([both]), x, R, rows).norm(dim=-1)
    alone = [bps_vectors(table_of(mesh), x, R, rows).norm(dim=-1) for mesh in (BOX, other)]
    assert torch.allclose(found, torch.minimum(*alone), atol=1e-12)
    places, index = np.unique(both[0], axis=0, return_inverse=True)
    refused(places, index.reshape(-1)[both[1]], "more than two")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_refuses_what_is_not_finite(value: float) -> None:
    vertices = BOX.vertices.copy()
    vertices[3, 1] = value
    refused(vertices, BOX.faces, "vertex 3 is .*not finite")


def test_refuses_zero_area() -> None:
    """A vertex in the middle of an edge, used by one neighbour only through a triangle of no height."""
    vertices = np.concatenate([BOX.vertices, [(BOX.vertices[0] + BOX.vertices[1]) / 2]])
    edge = (BOX.faces == 0).any(axis=1) & (BOX.faces == 1).any(axis=1)
    first, rest = BOX.faces[edge][0], np.delete(BOX.faces, np.flatnonzero(edge)[0], axis=0)
    start = next(i for i in range(3) if {first[i], first[(i + 1) % 3]} == {0, 1})
    a, b, c = np.roll(first, -start)
    refused(vertices, np.concatenate([rest, [(a, 8, c), (8, b, c), (a, b, 8)]]), "triangle 13 has no area")


@pytest.mark.parametrize(
    "vertices,faces,match",
    [
        (BOX.vertices[:, :2], BOX.faces, r"vertices are float64 of shape \(8, 2\)"),
        (BOX.vertices.astype(str), BOX.faces, "vertices are <U"),
        (BOX.vertices, BOX.faces.astype(float), "faces are float64"),
        (BOX.vertices, BOX.faces.ravel(), r"faces are .* of shape \(36,\)"),
        (BOX.vertices, BOX.faces[:2], "2 triangles cannot close"),
        (BOX.vertices[:5], BOX.faces, r"faces name vertices 0\.\.7, allowed 0\.\.4"),
        (BOX.vertices, BOX.faces - 1, r"faces name vertices -1\.\.6"),
        (BOX.vertices * 1e-10, BOX.faces, "fewer than 4 triangles"),
    ],
)
def test_refuses_malformed(vertices: np.ndarray, faces: np.ndarray, match: str) -> None:
    refused(vertices, faces, match)


def test_refuses_nothing_at_all() -> None:
    with pytest.raises(MeshError, match="at least one mesh"):
        MeshTable.from_meshes([])


@pytest.mark.parametrize("name,mesh", hard_shapes().items())
def test_triangle_soup_is_merged(name: str, mesh: trimesh.Trimesh) -> None:
    """As read from STL: every triangle with corners of its own; and a collapsed triangle in between."""
    soup = mesh.vertices[mesh.faces].reshape(-1, 3)
    faces = np.arange(len(soup)).reshape(-1, 3)
    x, R = random_poses(np.random.default_rng(12), 10)
    rows = torch.zeros(10, dtype=torch.int64)
    collapsed = MeshTable.from_meshes([(soup, np.concatenate([faces, [[0, 1, 1]]]))])
    assert torch.allclose(
        bps_vectors(collapsed, x, R, rows), bps_vectors(table_of(mesh), x, R, rows), atol=1e-15
    )


def test_length_triangles_and_extents() -> None:
    shapes = hard_shapes()
    table = table_of(*shapes.values())
    assert len(table) == len(shapes)
    assert np.allclose(table.extents, [mesh.extents for mesh in shapes.values()])
    for index, mesh in enumerate(shapes.values()):
        found = table.triangles(index)
        assert found.shape == (len(mesh.faces), 3, 3)
        assert {tuple(row) for row in found.reshape(-1, 9)} <= {
            tuple(np.roll(row, -k, axis=0).ravel()) for row in mesh.vertices[mesh.faces] for k in range(3)
        }
    with pytest.raises(IndexError):
        table.triangles(len(table))


def test_scaling_the_table_is_not_scaling_the_query() -> None:
    """A rebuilt table of the scaled mesh, checked where it can be computed by hand: ellipsoid poles."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    table = table_of(ball.copy().apply_scale((0.02, 0.03, 0.04)))
    assert np.allclose(table.extents, [[0.04, 0.06, 0.08]])


def test_thousand_variants_build_fast() -> None:
    rng = np.random.default_rng(13)
    objects = object_sets.load("all")
    scaled = [objects[i % 16].with_extents(rng.uniform(0.045, 0.09, 3)) for i in range(1024)]
    meshes = [(item.vertices, item.faces) for item in scaled]
    start = time.perf_counter()
    table = MeshTable.from_meshes(meshes)
    assert len(table) == 1024
    # generous: shared and slow machines; measured in benchmarks/bench_bps.py
    assert time.perf_counter() - start < 60
