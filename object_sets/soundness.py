"""What a sound surface is, for building and checking sets, for encodings and for whatever else measures distances.

Closed by its own indices, each edge with one face on either side, outward, and no face so thin that its normal is
noise: the sign of a distance is only right on such a surface. Where indices don't close it, equal positions may (STL).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from object_sets.edges import components
from object_sets.errors import MeshError
from object_sets.mass import signed_volume

if TYPE_CHECKING:
    from manifold3d import Manifold

#: Vertices that fall into the same cell of this size (m) can count as one vertex; a triangle lower has no area.
MERGE_DISTANCE = 1e-8
#: How much higher triangles are made when there is a choice: objects may be used at a tenth of their size.
MARGIN = 10.0
#: m, by which a surface may move so that slivers go; tried in turn.
TOLERANCES = (0.0, 1e-7, 1e-6, 1e-5, 3e-5)

AGAIN = "build the set again, or repair the mesh"


class Surface(NamedTuple):
    """A sound surface."""

    vertices: np.ndarray  # (V, 3) float64 m
    faces: np.ndarray  # (F, 3) int64, outward
    neighbours: np.ndarray  # (F, 3) int64, the face across each edge ab, bc, ca


def surface(vertices: Any, faces: Any, name: str, height: float = MERGE_DISTANCE) -> Surface:
    """Check a mesh: vertices (V, 3) m and faces (F, 3).

    Its vertices are taken as they are if that closes it; else those in one place are merged, and triangles that this
    collapses are dropped: their other two edges coincide, so the surface stays closed without them.

    Raises:
        MeshError: it isn't sound; the message names ``name`` and the defect. Triangles no higher than ``height`` (m)
            count as without area.
    """
    vertices, faces = _checked(vertices, faces, name)
    heights = _heights(vertices[faces])
    if heights.min() > height:
        neighbours = _neighbours(faces)
        if neighbours is not None:
            return _outward(vertices, faces, neighbours, name)
    vertices, faces = _merged(vertices, faces, name)
    heights = _heights(vertices[faces])
    if heights.min() <= height:
        index, count = int(np.argmax(heights <= height)), int((heights <= height).sum())
        raise MeshError(
            name,
            f"triangle {index} has no area (three corners on a line, height {heights[index]:.1e} m, allowed above "
            f"{height:.0e} m); {count} such slivers in this mesh",
            "retriangulate it: dropping them would open the surface",
        )
    neighbours = _neighbours(faces)
    if neighbours is None:
        raise _open(faces, name)
    return _outward(vertices, faces, neighbours, name)


def sound_mesh(solid: Manifold, center: str, name: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Vertices (V, 3) m and faces (F, 3) of a solid, sound, and by how many m at most it was moved for that.

    Unions leave slivers where surfaces cross. Raises ``MeshError`` where they stay within ``TOLERANCES``.
    """
    from object_sets.csg import canonical, to_mesh

    raw = to_mesh(solid, "origin")
    last = MeshError(name, "has no triangles", AGAIN)
    for height in (MARGIN * MERGE_DISTANCE, MERGE_DISTANCE):
        for tolerance in TOLERANCES:
            vertices, faces = _welded(*raw, tolerance) if tolerance else raw
            faces, turned = _without_slivers(vertices, faces, height)
            vertices, faces = canonical(vertices, faces, center)
            try:
                surface(vertices, faces, name, height)
            except MeshError as error:
                last = error if tolerance == 0.0 else last  # of the surface as it was, not of what was tried
            else:
                return vertices, faces, max(tolerance, height if turned else 0.0)
    raise last


def _welded(vertices: np.ndarray, faces: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Faces with both ends of every edge no longer than ``length`` (m) in one vertex.

    Those that this collapses go, and so do pairs that it puts back to back.
    """
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    short = np.linalg.norm(vertices[start] - vertices[end], axis=1) <= length
    labels = components(len(vertices), start[short], end[short])
    first = np.unique(labels, return_index=True)[1]
    faces = first[labels][faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    _, where, count = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
    return vertices, faces[count[where.reshape(-1)] == 1]


def _without_slivers(vertices: np.ndarray, faces: np.ndarray, height: float) -> tuple[np.ndarray, int]:
    """Faces in which triangles no higher than ``height`` (m) have given their longest edge to the corner before it.

    With the triangle across that edge, such a triangle is a quadrilateral with a corner on one of its diagonals: it is
    cut along the other one. Also returns how many were.
    """
    low = np.flatnonzero(_heights(vertices[faces]) <= height)
    if len(low) == 0:
        return faces, 0
    faces, turned = faces.copy(), 0
    sides = {
        (int(row[k]), int(row[(k + 1) % 3])): (index, k) for index, row in enumerate(faces) for k in range(3)
    }
    waiting = low.tolist()
    while waiting and turned < 10 * len(low):
        index = waiting.pop()
        row = vertices[faces[index]]
        k = int(np.linalg.norm(np.roll(row, -1, axis=0) - row, axis=1).argmax())
        a, b, c = np.roll(faces[index], -k).tolist()
        if _heights(row[None])[0] > height or (b, a) not in sides:
            continue
        other, place = sides[b, a]
        d = int(faces[other, (place + 2) % 3])
        if (c, d) in sides or (d, c) in sides or c == d:
            continue
        del sides[a, b], sides[b, a]
        for number, corners in ((index, (a, d, c)), (other, (d, b, c))):
            faces[number] = corners
            sides.update({(corners[i], corners[(i + 1) % 3]): (number, i) for i in range(3)})
            waiting.append(number)
        turned += 1
    return faces, turned


def _checked(vertices: Any, faces: Any, name: str) -> tuple[np.ndarray, np.ndarray]:
    """(V, 3) float64 and (F, 3) int64 after checking shapes, types, ranges and finiteness."""
    vertices, faces = np.asarray(vertices), np.asarray(faces)
    defect = ""
    if vertices.ndim != 2 or vertices.shape[1] != 3 or vertices.dtype.kind not in "fiu":
        defect = f"vertices are {vertices.dtype} of shape {vertices.shape}, expected float (V, 3)"
    elif faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        defect = f"faces are {faces.dtype} of shape {faces.shape}, expected integer (F, 3)"
    elif len(faces) < 4:
        defect = f"{len(faces)} triangles cannot close a volume, at least 4 are needed"
    elif not np.isfinite(vertices).all():
        index = int(np.argmin(np.isfinite(vertices).all(axis=1)))
        defect = f"vertex {index} is {vertices[index]}, not finite"
    elif faces.min() < 0 or faces.max() >= len(vertices):
        defect = f"faces name vertices {faces.min()}..{faces.max()}, allowed 0..{len(vertices) - 1}"
    if defect:
        raise MeshError(name, defect, AGAIN)
    return vertices.astype(np.float64), faces.astype(np.int64)


def _heights(corners: np.ndarray) -> np.ndarray:
    """(F,) m: the lowest height of each triangle (F, 3, 3); 0 where corners coincide."""
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    doubled = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return np.divide(doubled, longest, out=np.zeros(len(corners)), where=longest > 0)


def _merged(vertices: np.ndarray, faces: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices in the same cell as one, and the faces that then still have three corners."""
    cells = np.rint(vertices / MERGE_DISTANCE)
    _, first, ids = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    faces = ids.reshape(-1)[faces]
    kept = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    if kept.sum() < 4:
        raise MeshError(
            name, f"fewer than 4 triangles have three corners over {MERGE_DISTANCE} m apart", AGAIN
        )
    return vertices[first], faces[kept]


def _directed(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(3F,) numbers of the edges of faces as they pass them, and of the same edges passed the other way."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    base = int(faces.max()) + 1
    return start * base + end, end * base + start


def _neighbours(faces: np.ndarray) -> np.ndarray | None:
    """(F, 3) the face across each edge; None unless each edge is passed once in either direction."""
    forward, reverse = _directed(faces)
    order = np.argsort(forward, kind="stable")
    ordered = forward[order]
    place = np.minimum(np.searchsorted(ordered, reverse), len(ordered) - 1)
    if (ordered[1:] == ordered[:-1]).any() or (ordered[place] != reverse).any():
        return None
    return (order[place] // 3).reshape(-1, 3)


def _open(faces: np.ndarray, name: str) -> MeshError:
    forward, reverse = _directed(faces)
    if len(np.unique(forward)) < len(forward):
        defect = "an edge is used twice in one direction (inconsistent winding or more than two faces)"
    else:
        count = int((~np.isin(reverse, forward)).sum())
        defect = f"not watertight, {count} edges have no matching neighbour"
    return MeshError(name, defect, AGAIN)


def _outward(vertices: np.ndarray, faces: np.ndarray, neighbours: np.ndarray, name: str) -> Surface:
    volume = signed_volume(vertices, faces)
    if volume <= 0:
        raise MeshError(
            name, f"signed volume {volume:.3e} m^3, must be positive (faces wound outward)", AGAIN
        )
    return Surface(vertices, faces, neighbours)
