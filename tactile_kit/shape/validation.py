"""Checks at the door: signs from pseudonormals are only right on closed, outward, non-degenerate meshes."""

from __future__ import annotations

from typing import Any

import numpy as np

#: Vertices that fall into the same cell of this size (m) are one vertex; a triangle lower than this has no area.
MERGE_DISTANCE = 1e-8


class MeshError(ValueError):
    """A mesh that cannot be encoded; the message names the mesh and the defect."""


def checked_mesh(vertices: Any, faces: Any, index: int) -> tuple[np.ndarray, np.ndarray]:
    """One mesh as (V, 3) float64 and (F, 3) int64 after checking shapes, types, ranges and finiteness."""
    vertices, faces = np.asarray(vertices), np.asarray(faces)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or vertices.dtype.kind not in "fiu":
        raise MeshError(
            f"mesh {index}: vertices are {vertices.dtype} of shape {vertices.shape}, expected float (V, 3)"
        )
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise MeshError(
            f"mesh {index}: faces are {faces.dtype} of shape {faces.shape}, expected integer (F, 3)"
        )
    if len(faces) < 4:
        raise MeshError(f"mesh {index}: {len(faces)} triangles cannot close a volume, at least 4 are needed")
    vertices, faces = vertices.astype(np.float64), faces.astype(np.int64)
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        raise MeshError(
            f"mesh {index}: vertex {np.argmin(finite)} is {vertices[np.argmin(finite)]}, not finite"
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise MeshError(
            f"mesh {index}: faces name vertices {faces.min()}..{faces.max()}, allowed 0..{len(vertices) - 1}"
        )
    return vertices, faces


def merge_vertices(meshes: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All meshes end to end with coinciding vertices merged (STL holds three own corners a triangle).

    Returns vertices (V, 3), faces (F, 3) into them, and the mesh index of each face (F,). Triangles with two corners
    in one place are dropped: their other two edges coincide, so the surface stays closed without them.
    """
    counts = np.array([len(vertices) for vertices, _ in meshes])
    vertices = np.concatenate([vertices for vertices, _ in meshes])
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    faces = np.concatenate([faces + start for (_, faces), start in zip(meshes, starts, strict=True)])
    owner = np.repeat(np.arange(len(meshes)), [len(faces) for _, faces in meshes])
    cells = np.rint(vertices / MERGE_DISTANCE)
    mesh_of_vertex = np.repeat(np.arange(len(meshes)), counts)
    order = np.lexsort((cells[:, 2], cells[:, 1], cells[:, 0], mesh_of_vertex))
    keys = np.column_stack([mesh_of_vertex, cells])[order]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (keys[1:] != keys[:-1]).any(axis=1)
    ids = np.empty(len(order), dtype=np.int64)
    ids[order] = np.cumsum(new) - 1
    faces = ids[faces]
    kept = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    empty = np.bincount(owner[kept], minlength=len(meshes)) < 4
    if empty.any():
        raise MeshError(
            f"mesh {np.argmax(empty)}: fewer than 4 triangles have three corners over {MERGE_DISTANCE} m apart"
        )
    return vertices[order[new]], faces[kept], owner[kept]


def require_closed(corners: np.ndarray, faces: np.ndarray, owner: np.ndarray, number: int) -> np.ndarray:
    """Neighbour triangle across each edge ab, bc, ca: (F, 3) int64. Raises MeshError unless closed and outward."""
    first = np.searchsorted(owner, np.arange(number))
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    doubled = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    height = doubled / longest
    flat = height <= MERGE_DISTANCE
    if flat.any():
        index = int(np.argmax(flat))
        count = int((flat & (owner == owner[index])).sum())
        raise MeshError(
            f"mesh {owner[index]}: triangle {index - first[owner[index]]} has no area (three corners on a line, height "
            f"{height[index]:.1e} m, allowed above {MERGE_DISTANCE:.0e} m); {count} "
            "such slivers in this mesh: dropping them would open the surface, so retriangulate it"
        )
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    base = int(faces.max()) + 1
    forward, reverse = start * base + end, end * base + start
    order = np.argsort(forward, kind="stable")
    ordered = forward[order]
    twice = ordered[1:] == ordered[:-1]
    if twice.any():
        mesh = owner[order[1:][twice][0] // 3]
        raise MeshError(
            f"mesh {mesh}: an edge is used twice in one direction (inconsistent winding or more than two faces)"
        )
    place = np.minimum(np.searchsorted(ordered, reverse), len(ordered) - 1)
    single = ordered[place] != reverse
    if single.any():
        mesh = owner[np.argmax(single) // 3]
        count = int((single & (np.repeat(owner, 3) == mesh)).sum())
        raise MeshError(f"mesh {mesh}: not watertight, {count} edges have no matching neighbour")
    # Volumes relative to a corner of the mesh: far from the origin the plain sum would cancel.
    local = corners - corners[first][owner][:, :1]
    volume = np.bincount(
        owner, np.einsum("fi,fi->f", local[:, 0], np.cross(local[:, 1], local[:, 2])) / 6, number
    )
    if (volume <= 0).any():
        mesh = int(np.argmax(volume <= 0))
        raise MeshError(
            f"mesh {mesh}: signed volume {volume[mesh]:.3e} m^3, must be positive (faces wound outward)"
        )
    return (order[place] // 3).reshape(-1, 3)
