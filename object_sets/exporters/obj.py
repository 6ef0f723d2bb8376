"""Wavefront OBJ: the mesh, and a second file with one object a convex part."""

from __future__ import annotations

import numpy as np

from object_sets.exporters import about, number
from object_sets.objects import Object


def files(item: Object, mass: float) -> dict[str, str]:
    """``NAME.obj`` and ``NAME_parts.obj``; OBJ knows no mass."""
    parts = [f"# {about(item)}, convex parts, m\n"]
    offset = 1
    for index, corners in enumerate(item.parts):
        parts.append(f"o part_{index:03d}\n" + _lines(corners, hull_faces(corners), offset))
        offset += len(corners)
    return {f"{item.name}.obj": mesh_text(item), f"{item.name}_parts.obj": "".join(parts)}


def mesh_text(item: Object) -> str:
    """The mesh as a file."""
    return f"# {about(item)}, m\no {item.name}\n" + _lines(item.vertices, item.faces)


def part_files(item: Object) -> dict[str, str]:
    """Each convex part as a file of its own."""
    return {
        f"{item.name}_part_{index:03d}.obj": f"# {about(item)}, convex part {index}, m\n"
        + _lines(corners, hull_faces(corners))
        for index, corners in enumerate(item.parts)
    }


def hull_faces(corners: np.ndarray) -> np.ndarray:
    """(F, 3) int triangles, outward, of the convex hull of (n, 3) corners; in a fixed order."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(corners)
    faces = hull.simplices.astype(np.int64)
    a, b, c = corners[faces].transpose(1, 0, 2)
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward, ::-1]
    first = faces.argmin(axis=1)[:, None]
    faces = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    return faces[np.lexsort(faces.T[::-1])]


def _lines(vertices: np.ndarray, faces: np.ndarray, offset: int = 1) -> str:
    points = "".join(f"v {number(*point)}\n" for point in vertices.tolist())
    return points + "".join(f"f {a} {b} {c}\n" for a, b, c in (np.asarray(faces) + offset).tolist())
