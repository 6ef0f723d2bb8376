"""Repairs of a surface at its edges: vertices on a neighbour's edge, faces turned over, small holes."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from object_sets.edges import border
from object_sets.errors import MeshError

HOLE_AREA = 0.02  # of the surface: what filling holes may add


def without_junctions(
    vertices: np.ndarray, faces: np.ndarray, distance: float, repairs: list[str]
) -> np.ndarray:
    """Faces with their open edges split where other open edges end on them (within ``distance``): T-junctions.

    Where that leaves no fewer edges open, the faces stay as they are.
    """
    before, split, made = len(border(faces)), 0, faces
    while True:
        open_edges = border(made)
        loose = np.unique(np.stack([made[open_edges[:, 0], (open_edges[:, 1] + k) % 3] for k in (0, 1)]))
        tree = cKDTree(vertices[loose])
        pieces: dict[
            int, list[tuple[int, int, int]]
        ] = {}  # one edge of a face a round: its others may be split too
        for face, number in open_edges.tolist():
            a, b, c = np.roll(made[face], -number).tolist()
            along = _between(vertices, loose, tree, a, b, distance) if face not in pieces else []
            if along:
                chain = [a, *along, b]
                pieces[face] = [(start, end, c) for start, end in pairwise(chain)]
        if not pieces:
            break
        split += len(pieces)
        added = np.array([piece for group in pieces.values() for piece in group], np.int64)
        made = np.vstack([np.delete(made, list(pieces), axis=0), added])
    if not split or len(border(made)) >= before:
        return faces
    repairs.append(f"split {split} edges at vertices of their neighbours")
    return made


def _between(
    vertices: np.ndarray, loose: np.ndarray, tree: cKDTree, a: int, b: int, distance: float
) -> list[int]:
    """Those of the ``loose`` vertices that lie on the edge from a to b, its ends left out, in order."""
    edge = vertices[b] - vertices[a]
    length = float(np.linalg.norm(edge))
    near = loose[tree.query_ball_point((vertices[a] + vertices[b]) / 2.0, length / 2.0 + distance)]
    near = near[(near != a) & (near != b)]
    way = (vertices[near] - vertices[a]) @ edge / length
    off = np.linalg.norm(vertices[near] - vertices[a] - np.outer(way, edge / length), axis=1)
    on = (off <= distance) & (way > distance) & (way < length - distance)
    return near[on][np.argsort(way[on], kind="stable")].tolist()


def oriented(vertices: np.ndarray, faces: np.ndarray, repairs: list[str]) -> np.ndarray:
    """Faces turned to the side of their neighbours; in each connected piece the side with more area decides."""
    import trimesh

    mesh = trimesh.Trimesh(vertices, faces, process=False)
    labels = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(faces))
    areas = mesh.area_faces
    trimesh.repair.fix_winding(mesh)
    turned = (np.asarray(mesh.faces) != faces).any(axis=1)
    if not turned.any():
        return faces
    share = np.bincount(labels, weights=np.where(turned, areas, 0.0)) / np.maximum(
        np.bincount(labels, weights=areas), 1e-300
    )
    turned ^= share[labels] > 0.5
    repairs.append(f"turned {int(turned.sum())} faces to the side of their neighbours")
    return np.where(turned[:, None], faces[:, ::-1], faces)


def without_holes(
    path: Path, vertices: np.ndarray, faces: np.ndarray, repairs: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces with small holes closed. Raises ``MeshError`` where a hole is large, or no simple one."""
    import trimesh

    missing = len(border(faces))
    if not missing:
        return vertices, faces
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    area, count = mesh.area, len(mesh.faces)
    trimesh.repair.fill_holes(mesh)
    filled = np.array(mesh.faces, np.int64)
    if len(border(filled)) or mesh.area > (1.0 + HOLE_AREA) * area:
        raise MeshError(
            path,
            f"is open: {missing} edges border a hole",
            "close it in a modelling program, or have it remeshed",
        )
    repairs.append(f"closed holes with {missing} border edges by {len(filled) - count} faces")
    trimesh.repair.fix_winding(mesh)
    return np.array(mesh.vertices), np.array(mesh.faces, np.int64)
