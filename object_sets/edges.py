"""Edges of triangle meshes, and what hangs together across them."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def edges_of(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the sides of faces (F, 3) in turn: their edge (3F,), whether they pass it from low to high (3F,), and of the
    edges (E,) how many sides they have."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(start, end) * (faces.max(initial=0) + 1) + np.maximum(start, end)
    _, edge, uses = np.unique(key, return_inverse=True, return_counts=True)
    return edge.reshape(-1), start < end, uses


def border(faces: np.ndarray) -> np.ndarray:
    """(B, 2) places (face, number of its edge) of the edges that have one face only."""
    edge, _, uses = edges_of(faces)
    single = np.flatnonzero(uses[edge] == 1)
    return np.column_stack([single // 3, single % 3])


def components(count: int, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(count,) labels of the connected parts of a graph, numbered by first appearance."""
    graph = coo_array((np.ones(len(first), bool), (first, second)), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    _, index, labels = np.unique(labels, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(index))[labels]
