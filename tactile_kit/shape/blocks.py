"""Bounding boxes for big meshes: triangles in k-d order, in blocks of 16 with a box, boxes in groups of 16 lanes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

#: Triangles of a block, and boxes of a group: one AVX-512 register of float32 each.
BLOCK = 16
GROUP = 16


def kd_order(corners: np.ndarray) -> np.ndarray:
    """Order (F,) of triangles (F, 3, 3) that puts near ones together: halves along the widest axis of the centroids.

    Every cut falls on a multiple of BLOCK, so that blocks never straddle two cells.
    """
    centres = corners.mean(axis=1)
    order = np.arange(len(centres))
    stack = [(0, len(order))]
    while stack:
        start, stop = stack.pop()
        blocks = -(-(stop - start) // BLOCK)
        if blocks <= 1:
            continue
        part = order[start:stop]
        points = centres[part]
        axis = int(np.argmax(np.ptp(points, axis=0)))
        cut = (blocks // 2) * BLOCK
        order[start:stop] = part[np.argpartition(points[:, axis], cut)]
        stack += [(start, start + cut), (start + cut, stop)]
    return order


def block_bounds(corners: np.ndarray, offsets: np.ndarray, above: int) -> tuple[np.ndarray, np.ndarray]:
    """Boxes of the meshes with more than `above` triangles.

    Returns bounds (6, n * GROUP) float64, metres: low xyz and high xyz of each box; and the first group of each mesh
    (N + 1,) int64, equal to the next one where a mesh has no boxes. Missing boxes of a last group are far away, so
    they are never visited.
    """
    groups, first = [], [0]
    for start, stop in pairwise(offsets):
        count = 0
        if stop - start > above:
            cuts = np.arange(start, stop, BLOCK) - start
            low = np.minimum.reduceat(corners[start:stop].min(axis=1), cuts, axis=0)
            high = np.maximum.reduceat(corners[start:stop].max(axis=1), cuts, axis=0)
            count = -(-len(cuts) // GROUP)
            padded = np.full((count * GROUP, 6), 1e6)
            padded[: len(cuts)] = np.concatenate([low, high], axis=1)
            groups.append(padded.T)
        first.append(first[-1] + count)
    bounds = np.concatenate([np.zeros((6, 0)), *groups], axis=1)
    return bounds, np.array(first, dtype=np.int64)


def block_rows(rows: np.ndarray, offsets: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Search rows (F, 20) of the meshes with boxes again, triangles as lanes: (n * GROUP, 20, BLOCK).

    Lanes past the end of a mesh repeat its last triangle.
    """
    parts = [np.zeros((0, BLOCK, rows.shape[1]))]
    for mesh in np.flatnonzero(np.diff(first)):
        start, stop = offsets[mesh], offsets[mesh + 1]
        size = (first[mesh + 1] - first[mesh]) * GROUP * BLOCK
        parts.append(
            rows[np.minimum(np.arange(start, start + size), stop - 1)].reshape(-1, BLOCK, rows.shape[1])
        )
    return np.concatenate(parts).transpose(0, 2, 1)
