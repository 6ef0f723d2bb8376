"""Meshes that are hard for signs and closest points, and poses that put basis points where it hurts."""

from __future__ import annotations

import bps_twin as twin
import numpy as np
import torch
import trimesh
from scipy.spatial.transform import Rotation

from tactile_kit.shape import MeshTable, basis_points

POINTS = torch.from_numpy(basis_points())


def extruded(outline: list[tuple[float, float]], height: float) -> trimesh.Trimesh:
    """Prism over a polygon that is star-shaped about its first corner (m)."""
    low = np.column_stack([outline, np.full(len(outline), -height / 2)])
    vertices = np.concatenate([low, low + [0, 0, height]])
    n = len(outline)
    fan = [(0, i, i + 1) for i in range(1, n - 1)]
    sides = [(i, (i + 1) % n, n + i) for i in range(n)] + [
        ((i + 1) % n, n + (i + 1) % n, n + i) for i in range(n)
    ]
    faces = np.array([(a, c, b) for a, b, c in fan] + [(n + a, n + b, n + c) for a, b, c in fan] + sides)
    return trimesh.Trimesh(vertices, faces, process=False)


def tetrahedron(corners: list[tuple[float, float, float]]) -> trimesh.Trimesh:
    return trimesh.Trimesh(corners, [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)], process=False)


def hard_shapes() -> dict[str, trimesh.Trimesh]:
    """Slabs, spikes, wedges, notches; extents of centimetres."""
    notch = [(0.0, 0.0), (0.03, 0.03), (-0.03, 0.03), (-0.03, -0.03), (0.03, -0.03)]  # a square with a V cut
    corner = [
        (0.0, 0.0),
        (0.0, 0.035),
        (-0.035, 0.035),
        (-0.035, -0.035),
        (0.035, -0.035),
        (0.035, 0.0),
    ]  # an L
    saddle = trimesh.creation.icosphere(subdivisions=2, radius=0.03)
    radial = saddle.vertices / np.linalg.norm(saddle.vertices, axis=1, keepdims=True)
    saddle.vertices = saddle.vertices * (1 + 0.5 * np.sin(4 * radial[:, :1]) * np.cos(5 * radial[:, 1:2]))
    return {
        "box": trimesh.creation.box((0.0675, 0.05, 0.08)),
        "cylinder": trimesh.creation.cylinder(0.033, 0.06, sections=24),
        "slab": trimesh.creation.box((0.07, 0.07, 0.0005)),
        "paper": trimesh.creation.box((0.06, 0.08, 0.00001)),
        "needle": tetrahedron([(0, 0, 0), (0.002, 0, 0), (0, 0.002, 0), (0.0005, 0.0005, 0.09)]),
        "wedge": tetrahedron([(-0.04, 0, 0), (0.04, 0, 0), (0, 0.05, 0), (0, 0.05, 0.001)]),
        "spike": trimesh.creation.cone(radius=0.004, height=0.09, sections=7),
        "notch": extruded(notch, 0.06),
        "l": extruded(corner, 0.05),
        "torus": trimesh.creation.torus(0.03, 0.01, major_sections=20, minor_sections=10),
        "saddle": saddle,
        "stretched": trimesh.creation.icosphere(subdivisions=1, radius=0.03).apply_scale((1.5, 0.75, 0.1)),
        "dense": trimesh.creation.icosphere(subdivisions=3, radius=0.034).apply_scale((1.2, 0.7, 1.0)),
    }


def table_of(*meshes: trimesh.Trimesh) -> MeshTable:
    return MeshTable.from_meshes([(mesh.vertices, mesh.faces) for mesh in meshes])


def random_poses(
    rng: np.random.Generator, number: int, spread: float = 0.03
) -> tuple[torch.Tensor, torch.Tensor]:
    """x (B, 3) and R (B, 3, 3), float64."""
    R = Rotation.random(number, rng=rng).as_matrix()
    return torch.from_numpy(rng.normal(scale=spread, size=(number, 3))), torch.from_numpy(R)


def touching_poses(
    rng: np.random.Generator, corners: np.ndarray, number: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Poses that bring one basis point onto, or within 1e-9 to 1e-3 m of, a vertex, an edge or a face."""
    _, R = random_poses(rng, number)
    triangle = corners[rng.integers(len(corners), size=number)]
    weights = rng.dirichlet(np.ones(3), size=number)
    kind = rng.integers(3, size=number)  # vertex, edge, face
    weights[kind < 2, 2] = 0
    weights[kind < 1, 1] = 0
    weights /= weights.sum(axis=1, keepdims=True)
    weights = rng.permuted(weights, axis=1)
    gap = rng.choice([0.0, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3], size=(number, 1))
    direction = rng.normal(size=(number, 3))
    target = np.einsum("nk,nkj->nj", weights, triangle) + gap * direction / np.linalg.norm(
        direction, axis=1, keepdims=True
    )
    points = POINTS.numpy()[rng.integers(len(POINTS), size=number)]
    return torch.from_numpy(points - np.einsum("nij,nj->ni", R.numpy(), target)), R


def reference(table: MeshTable, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
    """The twin's vectors for a batch: (B, 64, 3) float64."""
    triangles = [torch.from_numpy(table.triangles(int(index))) for index in mesh]
    return torch.stack([twin.bps_vectors(POINTS, t, *pose) for t, *pose in zip(triangles, x, R, strict=True)])


def assert_exact(
    table: MeshTable,
    vectors: torch.Tensor,
    x: torch.Tensor,
    R: torch.Tensor,
    mesh: torch.Tensor,
    tolerance: float,
) -> int:
    """Distances, signs and feet against the twin; returns how many queries were inside.

    A foot must lie on the surface: together with the right distance this makes it a closest point, also where several
    are equally near. Within 1e-6 m of the surface either sign is allowed.
    """
    inside = 0
    for v, position, rotation, index in zip(vectors.double(), x.double(), R.double(), mesh, strict=True):
        posed = torch.from_numpy(table.triangles(int(index))) @ rotation.T + position
        closest = twin.closest_points(POINTS, posed)
        distance = torch.linalg.vector_norm(closest - POINTS, dim=-1)
        within = twin.inside(POINTS, posed)
        length = torch.linalg.vector_norm(v, dim=-1)
        clear = distance > 1e-6
        assert torch.equal((length == 0)[clear], within[clear]), "sign error"
        free = ~within & clear
        assert ((length - distance)[free].abs() <= tolerance).all()
        assert (length[~clear] <= 1e-6 + tolerance).all()
        # Where several surface points are equally near, another one than the twin's is right too if it is on
        # the surface.
        other = free & (torch.linalg.vector_norm(POINTS + v - closest, dim=-1) > tolerance)
        if other.any():
            feet = (POINTS + v)[other]
            miss = torch.linalg.vector_norm(twin.closest_points(feet, posed) - feet, dim=-1)
            assert miss.max() <= tolerance
        inside += int(within.sum())
    return inside
