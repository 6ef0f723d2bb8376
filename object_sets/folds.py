"""Plane pieces of a surface that fold over themselves, as fans over concave polygons do: cut anew.

Exporters that cut every polygon from its first corner leave triangles that lie upon each other, back to back. The
volume is right, but the surface is larger than the shape's, and distances to it are wrong.
"""

from __future__ import annotations

import numpy as np

from object_sets.edges import components, edges_of

PLANE = 1e-9  # 1 - cosine of the angle between faces that lie in one plane
FLAT = 1e-9  # area over squared length of a face whose corners lie on a line: it has no normal
AREA = 1e-6  # of a piece's area: what a new cut may differ by


def without_folds(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, int]:
    """Faces (F, 3) of a closed surface, each edge with two of them, with folded plane pieces cut anew; how many."""
    corners = vertices[faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0
    sizes = np.linalg.norm(areas, axis=1)
    normals = np.divide(areas, sizes[:, None], out=np.zeros_like(areas), where=sizes[:, None] > 0)
    edge, _, _ = edges_of(faces)
    first, second = np.argsort(edge, kind="stable").reshape(-1, 2).T // 3
    thin = sizes <= FLAT * np.square(np.ptp(corners, axis=1).max(axis=1))
    _borrow_normals(normals, thin, first, second)
    cosine = np.einsum("ei,ei->e", normals[first], normals[second])
    folded = cosine < PLANE - 1.0
    if not folded.any():
        return faces, 0
    flat = np.abs(cosine) > 1.0 - PLANE
    labels = components(len(faces), first[flat], second[flat])
    kept, added = np.ones(len(faces), bool), [np.zeros((0, 3), np.int64)]
    for label in np.unique(labels[first[folded]]):
        piece = labels == label
        made = _cut(vertices, faces[piece], areas[piece].sum(axis=0))
        if made is not None:
            kept[piece] = False
            added.append(made)
    return np.concatenate([faces[kept], *added]), int((~kept).sum())


def _borrow_normals(normals: np.ndarray, thin: np.ndarray, first: np.ndarray, second: np.ndarray) -> None:
    """A face without a height lies in the plane that two of its neighbours have in common, where they have one."""
    normals[thin] = 0.0
    beside_all = np.concatenate([second, first])[np.argsort(np.concatenate([first, second]), kind="stable")]
    for face in np.flatnonzero(thin):
        beside = beside_all[3 * face : 3 * face + 3]  # each face has three
        around = normals[beside[~thin[beside]]]
        parallel = np.abs(around @ around.T) > 1.0 - PLANE
        one = np.nonzero(np.triu(parallel, 1))[0]
        if len(one):
            normals[face] = around[one[0]]


def _cut(vertices: np.ndarray, faces: np.ndarray, area: np.ndarray) -> np.ndarray | None:
    """Triangles that fill the border of a plane piece of vector area (3,) once; None where its border is no polygon."""
    from manifold3d import triangulate

    size = float(np.linalg.norm(area))
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2).tolist()
    ahead: dict[int, list[int]] = {}
    inner = {(start, end) for start, end in sides}
    for start, end in sides:
        if (end, start) not in inner:
            ahead.setdefault(start, []).append(end)
    if size == 0 or not ahead or any(len(ends) > 1 for ends in ahead.values()):
        return None
    loops, left = [], {start: ends[0] for start, ends in ahead.items()}
    while left:
        start, place = left.popitem()
        loop = [start]
        while place != start:
            if place not in left:
                return None
            loop.append(place)
            place = left.pop(place)
        loops.append(loop)
    normal = area / size
    x = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    x /= np.linalg.norm(x)
    order = np.array([corner for loop in loops for corner in loop], np.int64)
    points = (vertices[order] - vertices[order].mean(axis=0)) / np.sqrt(size)
    plane = points @ np.column_stack([x, np.cross(normal, x)])
    cuts = triangulate(np.split(plane, np.cumsum([len(loop) for loop in loops])[:-1]))
    a, b, c = plane[cuts].transpose(1, 0, 2)
    twice = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    return order[cuts] if abs(twice.sum() / 2.0 - 1.0) < AREA else None
