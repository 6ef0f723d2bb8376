"""On request: a closed surface around whatever a file holds, by distances on a grid; how far it moved is measured.

What can't be reached from outside through gaps wider than two cells is solid, cavities included, with a coat of one
cell: sheets become walls of two. Then it is brought back to the old bounding box, so that thick bodies stay as large.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from manifold3d import Manifold
from scipy.ndimage import distance_transform_edt, label
from scipy.spatial import cKDTree

CELLS = (64, 40)  # along the largest extent; the coarser where the finer is too fine to simplify
SHEET = 1.0  # cells: the coat, half the thickness that sheets get
EDGE = 1.0  # cells: edges of the new surface
DENSITY = 12.0  # points on the square of a cell: the chance that one is farther than a cell from all is nil
MOST = 3_000_000  # points
SAMPLES = 4000  # points that the deviation is measured at


def remeshed(
    path: Path, vertices: np.ndarray, faces: np.ndarray, cells: int, reason: str, repairs: list[str]
) -> Manifold:
    """A solid of any triangles (V, 3), (F, 3); why and how far the surface moved is added to ``repairs``."""
    low, high = vertices[np.unique(faces)].min(axis=0), vertices[np.unique(faces)].max(axis=0)
    size = float((high - low).max())
    cell = size / cells
    dense = _dense(vertices, faces, cell)
    start = low - 4.0 * cell
    shape = np.ceil((high - low) / cell).astype(int) + 9
    field = _field(dense, start, shape, cell)
    bounds = [*(start + cell), *(start + (shape - 2) * cell)]
    lookup = _lookup(field, start, cell)
    solid = Manifold.level_set(lookup, bounds, EDGE * cell)
    solid = solid.simplify(0.1 * cell)
    solid = _fitted(solid.simplify(0.1 * cell), low, high, cell)
    mesh = solid.to_mesh64()
    made = _dense(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts, np.int64), cell)
    generator = np.random.default_rng(0)
    samples = generator.choice(dense, SAMPLES)
    # Of the old surface inner walls don't count, which are meant to go.
    there = cKDTree(made).query([point for point in samples if lookup(*point.tolist()) < 1.5 * cell])[0]
    back = cKDTree(dense).query(generator.choice(made, SAMPLES))[0]
    repairs.append(
        f"remeshed in cells of {100 / cells:.3g} % of its size, since it {reason}: the surface moved by "
        f"{100 * max(there.max(), back.max()) / size:.2g} % of its size at most, "
        f"{100 * (there.mean() + back.mean()) / 2 / size:.2g} % in the mean"
    )
    return solid


def _fitted(solid: Manifold, low: np.ndarray, high: np.ndarray, cell: float) -> Manifold:
    """The solid in the box from ``low`` to ``high`` (3,), but for sides that a coat would make up most of."""
    lower, upper = np.array(solid.bounding_box()).reshape(2, 3)
    wide = high - low > 8.0 * cell
    factors = np.where(wide, (high - low) / (upper - lower), 1.0)
    moved = solid.translate(tuple(-(lower + upper) / 2.0)).scale(tuple(factors))
    return moved.translate(tuple((low + high) / 2.0))


def _dense(vertices: np.ndarray, faces: np.ndarray, cell: float) -> np.ndarray:
    """Points (N, 3) on the triangles, so many that about ``DENSITY`` fall on the square of a cell."""
    from object_sets.quality import sample_surface

    corners = vertices[faces]
    area = (
        np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
        / 2
    )
    count = int(min(DENSITY * area / cell**2, MOST)) + SAMPLES
    return np.vstack([vertices[np.unique(faces)], sample_surface(vertices, faces, count, seed=0)])


def _field(surface: np.ndarray, start: np.ndarray, shape: np.ndarray, cell: float) -> np.ndarray:
    """Distances from the new surface at the points of a grid of ``shape`` (3,), positive inside.

    ``surface`` (N, 3) are points of the old one.
    """
    axes = [start[k] + cell * np.arange(shape[k]) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    distance = _distance(surface, grid, 6.0 * cell).reshape(shape)
    free = label(distance > cell)[0]
    outside = free == free[0, 0, 0]
    # Deep inside walls are no surface; what is shut off is inside.
    inside = cell * distance_transform_edt(~outside) - 2.0 * cell
    inside[(free > 0) & ~outside] = cell
    return np.maximum(inside, SHEET * cell - distance)


def _distance(points: np.ndarray, places: np.ndarray, most: float) -> np.ndarray:
    """(N,) how far each of the places (N, 3) is from the nearest of the points, ``most`` at the farthest."""
    if len(points) == 0:
        return np.full(len(places), most)
    return np.minimum(cKDTree(points).query(places, distance_upper_bound=most)[0], most)


def _lookup(field: np.ndarray, start: np.ndarray, cell: float) -> Callable[[float, float, float], float]:
    """The field at any point inside the grid, linear between its points."""
    values, (_, rows, columns) = field.ravel().tolist(), field.shape
    x0, y0, z0 = start.tolist()
    across = rows * columns

    def at(x: float, y: float, z: float) -> float:
        x, y, z = (x - x0) / cell, (y - y0) / cell, (z - z0) / cell
        i, j, k = int(x), int(y), int(z)
        x, y, z = x - i, y - j, z - k
        n = i * across + j * columns + k
        near = (values[n] * (1 - z) + values[n + 1] * z) * (1 - y) + (
            values[n + columns] * (1 - z) + values[n + columns + 1] * z
        ) * y
        n += across
        far = (values[n] * (1 - z) + values[n + 1] * z) * (1 - y) + (
            values[n + columns] * (1 - z) + values[n + columns + 1] * z
        ) * y
        return near * (1 - x) + far * x

    return at
