"""How well convex parts stand for a solid: volume and Hausdorff distance, measured, not promised."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

SAMPLES = 2000  # points on each surface; its corners come on top


class PartErrors(NamedTuple):
    """Errors of the union of the parts against the solid inside the mesh."""

    volume: float  # (volume of the union - volume of the solid) / volume of the solid, signed
    symmetric_difference: float  # volume that is in only one of the two / volume of the solid
    hausdorff: (
        float  # m, Hausdorff distance of the two solids, from the corners and samples of their surfaces
    )


def part_errors(
    vertices: np.ndarray, faces: np.ndarray, parts: Sequence[np.ndarray], seed: int = 0
) -> PartErrors:
    """Compare convex parts, each (n, 3) m, with the solid inside a mesh: vertices (V, 3) m, faces (F, 3)."""
    from scipy.spatial import ConvexHull

    from object_sets.csg import convex_hull, to_manifold, union

    solid = to_manifold(vertices, faces)
    together = union(convex_hull(part) for part in parts)
    volume = solid.volume()
    apart = (together - solid).volume() + (solid - together).volume()
    hulls = [ConvexHull(part) for part in parts]

    points = np.vstack([vertices, sample_surface(vertices, faces, SAMPLES, seed)])
    missed = points[
        np.min([(points @ h.equations[:, :3].T + h.equations[:, 3]).max(axis=1) for h in hulls], 0) > 0
    ]
    uncovered = np.min([surface_distance(missed, part, h.simplices) for part, h in zip(parts, hulls)], axis=0)
    # Only what sticks out of the solid counts: walls between parts lie inside and mean nothing.
    count = -(-SAMPLES // len(parts))
    walls = [
        np.vstack([part, sample_surface(part, h.simplices, count, seed)]) for part, h in zip(parts, hulls)
    ]
    outside = np.vstack(walls)
    outside = outside[winding_numbers(outside, vertices, faces) < 0.5]
    excess = surface_distance(outside, vertices, faces)
    hausdorff = max(uncovered.max(initial=0.0), excess.max(initial=0.0))
    return PartErrors(float(together.volume() / volume - 1.0), float(apart / volume), float(hausdorff))


def sample_surface(vertices: np.ndarray, faces: np.ndarray, count: int, seed: int) -> np.ndarray:
    """``count`` points (count, 3), uniform on the surface; the seed alone decides which."""
    generator = np.random.default_rng(np.random.SeedSequence(seed))
    corners = vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = corners[generator.choice(len(faces), size=count, p=areas / areas.sum())]
    root, second = np.sqrt(generator.random(count)), generator.random(count)
    weights = np.column_stack([1.0 - root, root * (1.0 - second), root * second])
    return np.einsum("ni,nij->nj", weights, chosen)


def surface_distance(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(N,) float64 m: distance of points (N, 3) from the surface (not the solid)."""
    import trimesh

    if len(points) == 0:
        return np.zeros(0)
    _, distance, _ = trimesh.proximity.closest_point(trimesh.Trimesh(vertices, faces, process=False), points)
    return distance


def winding_numbers(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(N,) float64: how often the surface encloses each point (N, 3); 1 inside and 0 outside a sound solid."""
    angles = np.empty(len(points))
    for i, point in enumerate(points):
        corners = vertices[faces] - point
        lengths = np.linalg.norm(corners, axis=2)
        a, b, c = corners.transpose(1, 0, 2)
        la, lb, lc = lengths.T
        determinant = np.einsum("fi,fi->f", a, np.cross(b, c))
        dots = (
            np.einsum("fi,fi->f", a, b) * lc
            + np.einsum("fi,fi->f", b, c) * la
            + np.einsum("fi,fi->f", c, a) * lb
        )
        angles[i] = 2.0 * np.arctan2(determinant, la * lb * lc + dots).sum()
    return angles / (4.0 * np.pi)
