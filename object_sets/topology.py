"""From triangles to closed bodies: which faces belong together, and which side of each edge they meet on.

A file says in three ways what belongs together, the surest first: faces that share vertices by index, faces listed in
one group, and equal positions. A body that is closed by a surer way is taken as it is, so bodies that touch stay apart.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from object_sets.edges import border, components, edges_of
from object_sets.errors import MeshError
from object_sets.folds import without_folds
from object_sets.mass import signed_volume
from object_sets.stitching import oriented, without_holes, without_junctions

ROUNDING = 1e-7  # of the largest extent: positions nearer than this are one


class Bodies(NamedTuple):
    """Closed surfaces, each edge with one face on either side; not one shares a vertex index with another."""

    vertices: np.ndarray  # (V, 3) float64
    faces: tuple[np.ndarray, ...]  # each (F_i, 3) int64, one side of it outside, which is not yet known


def closed_bodies(
    path: Path, vertices: np.ndarray, faces: np.ndarray, groups: np.ndarray, repairs: list[str]
) -> Bodies:
    """Bodies of faces (F, 3) in groups (F,); what had to be changed is added to ``repairs``.

    Raises:
        MeshError: a surface stays open, branches, or has no two sides.
    """
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    size = float(np.ptp(vertices, axis=0).max())
    places, place = np.unique(vertices, axis=0, return_inverse=True)
    place = place.reshape(-1)
    bodies, left = [], np.arange(len(faces))
    group_of = np.unique(groups, return_inverse=True)[1].reshape(-1, 1)
    # By index; by group and position: the same position written once a face or a texture corner is how files are.
    for names in (faces, group_of * len(places) + place[faces]):
        if len(left):
            labels, closed = _closed_parts(names[left])
            bodies += [
                (vertices, faces[left[labels == label]])
                if names is faces
                else (places, place[faces[left[labels == label]]])
                for label in np.unique(labels[closed])
            ]
            left = left[~closed]
    if len(left):
        bodies += _by_position(path, places, place[faces[left]], size, repairs)
    bodies = _without_copies(bodies, repairs)
    faces_of, points, start, folded = [], [], 0, 0
    for own_vertices, own_faces in bodies:
        index, renamed = np.unique(own_faces, return_inverse=True)
        points.append(own_vertices[index])
        whole, cut = without_folds(points[-1], renamed.reshape(-1, 3))
        faces_of.append(whole + start)
        start, folded = start + len(index), folded + cut
    if folded:
        repairs.append(f"cut {folded} faces anew that lay upon each other in a plane")
    return Bodies(np.concatenate(points), tuple(faces_of))


def _closed_parts(names: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Labels (F,) of the parts that faces (F, 3) form across edges, and whether a face's part is closed (F,).

    Closed is where each edge has two faces that pass it in opposite directions.
    """
    edge, forward, uses = edges_of(np.unique(names, return_inverse=True)[1].reshape(-1, 3))
    good = (uses == 2) & (np.bincount(edge, weights=np.where(forward, 1.0, -1.0)) == 0)
    face = np.repeat(np.arange(len(names)), 3)
    proper = (names != np.roll(names, 1, axis=1)).all(axis=1)
    labels = components(len(names) + len(uses), face, len(names) + edge)[: len(names)]
    bad = np.zeros(labels.max() + 1, bool)
    bad[labels[face[~good[edge]]]] = True
    bad[labels[~proper]] = True
    return labels, ~bad[labels]


def _by_position(
    path: Path, vertices: np.ndarray, faces: np.ndarray, size: float, repairs: list[str]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Bodies of what is joined by equal positions only: cleaned, closed, turned, and parted where it branches."""
    faces = _proper(faces, repairs)
    if len(border(faces)):
        names = _merged(vertices[: faces.max(initial=-1) + 1], ROUNDING * size)
        merged = len(np.unique(faces)) - len(np.unique(names[faces]))
        if merged:
            repairs.append(f"merged {merged} vertices that lay within rounding of others")
            faces = _proper(names[faces], repairs)
    faces = _without_repeats(faces, repairs)
    if len(faces) < 4:
        raise MeshError(path, f"has {len(faces)} proper triangles", "a solid needs at least 4")
    faces = without_junctions(vertices, faces, ROUNDING * size, repairs)
    faces = oriented(vertices, faces, repairs)
    uses = edges_of(faces)[2]
    _check_branches(path, int(((uses > 2) & (uses % 2 == 1)).sum()))
    vertices, faces = without_holes(path, vertices, faces, repairs)
    vertices, faces, labels = _parted(path, vertices, faces)
    return [(vertices, faces[labels == label]) for label in range(labels.max() + 1)]


def _proper(faces: np.ndarray, repairs: list[str]) -> np.ndarray:
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    if not proper.all():
        repairs.append(f"dropped {int((~proper).sum())} faces with repeated corners")
    return faces[proper]


def _merged(vertices: np.ndarray, distance: float) -> np.ndarray:
    """(V,) the vertex that stands for each; those within ``distance`` of each other have one."""
    pairs = cKDTree(vertices).query_pairs(distance, output_type="ndarray")
    labels = components(len(vertices), pairs[:, 0], pairs[:, 1])
    return np.unique(labels, return_index=True)[1][labels]


def _without_repeats(faces: np.ndarray, repairs: list[str]) -> np.ndarray:
    """Faces with the same corners: a wall between two bodies goes with both its sides, of anything else one stays."""
    _, first, inverse = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_inverse=True)
    if len(first) == len(faces):
        return faces
    inverse = inverse.reshape(-1)
    shift = faces.argmin(axis=1)[:, None] + np.arange(3)
    turned = np.take_along_axis(faces, shift % 3, axis=1)
    side = np.where(turned[:, 1] < turned[:, 2], 1.0, -1.0)
    wall = (np.bincount(inverse, weights=side) == 0)[inverse]
    once = np.sort(first)
    kept = once[~wall[once]]
    if wall.any() and len(kept) and (edges_of(faces[kept])[2] % 2 == 0).all():
        repairs.append(f"removed {int(wall.sum()) // 2} inner walls between bodies that share a face")
        if (repeated := len(faces) - int(wall.sum()) - len(kept)) > 0:
            repairs.append(f"dropped {repeated} repeated faces")
        return faces[kept]
    repairs.append(f"dropped {len(faces) - len(once)} repeated faces")
    return faces[once]


def _parted(path: Path, vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, faces and the body of each face (F,), with the faces about each edge put together in twos.

    Where more than two meet at an edge, those with solid between them belong together.
    """
    edge, forward, uses = edges_of(faces)
    unbalanced = np.bincount(edge, weights=np.where(forward, 1.0, -1.0)) != 0
    _check_branches(path, int((unbalanced & (uses > 2)).sum()))
    if unbalanced.any():
        raise MeshError(
            path,
            "its faces have no common outside (a one-sided surface)",
            "model a closed solid, or have it remeshed",
        )
    order = np.argsort(edge, kind="stable")
    firsts = np.concatenate([[0], np.cumsum(uses)[:-1]])
    two = firsts[uses == 2]
    pairs = [np.column_stack([order[two], order[two + 1]])]
    outward = signed_volume(vertices, faces) >= 0
    for index in np.flatnonzero(uses > 2):
        around = order[firsts[index] : firsts[index] + uses[index]]
        pairs.append(_paired(vertices, faces, around, forward[around], outward))
    first, second = np.concatenate(pairs).T
    after = lambda side: side // 3 * 3 + (side % 3 + 1) % 3  # noqa: E731
    names = components(
        3 * len(faces), np.concatenate([first, after(first)]), np.concatenate([after(second), second])
    )
    _, corner = np.unique(names, return_index=True)
    labels = components(len(faces), first // 3, second // 3)
    return vertices[faces.ravel()[corner]], names.reshape(-1, 3), labels


def _check_branches(path: Path, count: int) -> None:
    if count:
        raise MeshError(
            path, f"{count} edges belong to more than two faces, which bound no bodies",
            "remove inner walls and loose faces, and separate bodies that touch along an edge, or have it remeshed",
        )  # fmt: skip


def _paired(
    vertices: np.ndarray, faces: np.ndarray, sides: np.ndarray, forward: np.ndarray, outward: bool
) -> np.ndarray:
    """Which two of the half edges (n,) at one edge belong together, (n / 2, 2)."""
    face, place = sides // 3, sides % 3
    low, high = np.sort([faces[face[0], place[0]], faces[face[0], (place[0] + 1) % 3]])
    axis = (vertices[high] - vertices[low]) / np.linalg.norm(vertices[high] - vertices[low])
    arms = vertices[faces[face, (place + 2) % 3]] - vertices[low]
    arms -= np.outer(arms @ axis, axis)
    x = arms[0] / np.linalg.norm(arms[0])
    angles = np.round(np.arctan2(arms @ np.cross(axis, x), arms @ x) % (2 * np.pi), 6)
    angles[angles >= round(2 * np.pi, 6)] = 0.0
    # Turning about the axis, solid ends at a face that passes along it: its normal points on. At equal angles the
    # solid that ends there comes first, so that bodies with a common wall part.
    opens = forward != outward
    turn = np.lexsort((opens, angles))
    level = np.cumsum(np.where(opens[turn], 1, -1))
    turn = np.roll(turn, -1 - int(level.argmin()))
    waiting, pairs = [], []
    for side in turn:
        if opens[side]:
            waiting.append(sides[side])
        else:
            pairs.append((waiting.pop(), sides[side]))
    return np.array(pairs)


def _without_copies(
    bodies: list[tuple[np.ndarray, np.ndarray]], repairs: list[str]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Each body once: the same triangles, on whichever side, are the same body."""
    seen: set[bytes] = set()
    kept, dropped = [], 0
    for vertices, faces in bodies:
        corners = vertices[faces] + 0.0
        order = np.lexsort(np.moveaxis(corners, 2, 0)[::-1], axis=1)
        rows = np.take_along_axis(corners, order[:, :, None], axis=1).reshape(-1, 9)
        key = rows[np.lexsort(rows.T[::-1])].tobytes()
        if key in seen:
            dropped += len(faces)
        else:
            seen.add(key)
            kept.append((vertices, faces))
    if dropped:
        repairs.append(f"dropped {dropped} repeated faces")
    return kept
