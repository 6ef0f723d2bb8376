"""Triangle tables: what the closest-point kernel reads, built once per mesh.

All meshes lie end to end in one array with an offset per mesh (ragged, no padding), so a batch over different meshes
is one call with a mesh index per environment. Tables belong to the *scaled* mesh: a per-axis scale changes normals,
corner angles and which feature is nearest, so a new size is a new entry, never a scaled query.

Pseudonormals follow Baerentzen and Aanaes, "Signed distance computation using the angle weighted pseudonormal" (2005).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from object_sets.errors import MeshError
from object_sets.soundness import surface
from tactile_kit.shape.blocks import block_bounds, block_rows, kd_order

#: Meshes with more triangles than this are searched through bounding boxes (measured crossover 300 to 1000).
CULLING_ABOVE = 512


class MeshTable:
    """Triangle meshes prepared for exact closest-point queries (paper section III-A, eq. 4).

    Attributes:
        offsets: (N + 1,) int64, the triangles of mesh i are ``offsets[i]:offsets[i + 1]``.
        corners: (F, 3, 3) float64, metres, canonical frame; triangle, corner, coordinate; all meshes end to end.
        extents: (N, 3) float64, metres, bounding box of each mesh.
    """

    def __init__(
        self, corners: np.ndarray, offsets: np.ndarray, neighbours: np.ndarray, vertices: np.ndarray
    ) -> None:
        """Use :meth:`from_meshes`. neighbours (F, 3) triangle across edges ab, bc, ca; vertices (F, 3) vertex ids."""
        order = np.arange(len(corners))
        for start, stop in pairwise(offsets):
            if stop - start > CULLING_ABOVE:
                order[start:stop] = start + kd_order(corners[start:stop])
        normals, features = pseudonormals(corners, neighbours, vertices)
        self.offsets = offsets
        self.corners = corners[order]
        search, frames = search_rows(self.corners, normals[order])
        # Pseudonormals in each triangle's own frame: the winner's offset is known there.
        finish = np.einsum("fij,fkj->fki", frames, features[order]).reshape(len(order), 21)
        bounds, block_offsets = block_bounds(self.corners, offsets, CULLING_ABOVE)
        blocks = block_rows(search, offsets, block_offsets)
        self._arrays: dict[np.dtype, tuple[np.ndarray, ...]] = {}
        for dtype in (np.float32, np.float64):
            self._arrays[np.dtype(dtype)] = (
                offsets,
                np.ascontiguousarray(search, dtype=dtype),
                np.ascontiguousarray(finish, dtype=dtype),
                block_offsets,
                _rounded_outwards(bounds, dtype),
                np.ascontiguousarray(blocks, dtype=dtype),
            )
        starts = offsets[:-1]
        low = np.minimum.reduceat(self.corners.min(axis=1), starts, axis=0)
        high = np.maximum.reduceat(self.corners.max(axis=1), starts, axis=0)
        self.extents = high - low

    @classmethod
    def from_meshes(cls, meshes: Iterable[tuple[Any, Any]], names: Sequence[str] | None = None) -> MeshTable:
        """Check and prepare meshes.

        meshes: pairs of vertices (V, 3) float, metres, canonical frame, and faces (F, 3) int, outward winding.
        Vertices closer than 1e-8 m are merged where that is needed to close a mesh.
        names: what each mesh is called in errors, by default "mesh 0", "mesh 1", ...

        Raises MeshError (a ValueError) naming mesh and defect where a mesh is not sound as ``object_sets.soundness``
        says: wrong shape or type, not finite, index out of range, zero-area triangle, open or non-manifold edge,
        inconsistent or inward winding.
        """
        pairs = list(meshes)
        if not pairs:
            raise MeshError("MeshTable", "needs at least one mesh, got none", "name an object")
        called = names if names is not None else [f"mesh {index}" for index in range(len(pairs))]
        checked = [surface(*pair, name) for pair, name in zip(pairs, called, strict=True)]
        offsets = np.cumsum([0, *(len(item.faces) for item in checked)], dtype=np.int64)
        starts = np.cumsum([0, *(len(item.vertices) for item in checked)])
        corners = np.concatenate([item.vertices[item.faces] for item in checked])
        neighbours = np.concatenate([item.neighbours + start for item, start in zip(checked, offsets)])
        faces = np.concatenate([item.faces + start for item, start in zip(checked, starts)])
        return cls(corners, offsets, neighbours, faces)

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def triangles(self, index: int) -> np.ndarray:
        """Corners of one mesh: (F_i, 3, 3) float64, metres, canonical frame."""
        if not 0 <= index < len(self):
            raise IndexError(f"mesh index {index} is outside 0..{len(self) - 1}")
        return self.corners[self.offsets[index] : self.offsets[index + 1]]

    def arrays(self, dtype: np.dtype) -> tuple[np.ndarray, ...]:
        """Kernel arrays of one precision (float32 or float64): offsets, search rows, pseudonormals, blocks, bounds."""
        return self._arrays[dtype]

    def __repr__(self) -> str:
        return f"MeshTable({len(self)} meshes, {len(self.corners)} triangles)"


def pseudonormals(
    corners: np.ndarray, neighbours: np.ndarray, vertices: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals of faces (F, 3) and of the seven features (F, 7, 3): face, edges ab bc ca, vertices a b c."""
    edges = np.roll(corners, -1, axis=1) - corners  # ab, bc, ca
    cross = np.cross(edges[:, 0], -edges[:, 2])
    normals = _unit(cross)
    edge_normals = _unit(normals[:, None] + normals[neighbours])
    backward = -np.roll(edges, 1, axis=1)  # from each corner to the one before it
    # atan2 keeps the angle of a needle-thin corner, where arccos loses all digits.
    sine = np.linalg.norm(np.cross(edges, backward), axis=-1)
    angles = np.arctan2(sine, np.einsum("fki,fki->fk", edges, backward))
    weighted = angles[..., None] * normals[:, None]
    ids = vertices.ravel()
    total = np.stack([np.bincount(ids, weights=weighted[..., axis].ravel()) for axis in range(3)], axis=-1)
    return normals, np.concatenate([normals[:, None], edge_normals, _unit(total[vertices])], axis=1)


def search_rows(corners: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of 20 numbers a triangle for the search, and the frames (F, 3, 3) with rows u (along ab), w, n.

    Columns: 0-3 u and -u.a, 4-7 w and -w.a, 8-11 n and -n.a, 12 |ab|, 13-15 direction and length of bc,
    16-18 direction and length of ac, 19 unused (keeps rows aligned). Directions are 2-D, in (u, w).
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    u = _unit(b - a)
    w = np.cross(normals, u)
    frames = np.stack([u, w, normals], axis=1)
    flat_b = np.linalg.norm(b - a, axis=1)
    flat_c = np.einsum("fij,fj->fi", frames[:, :2], c - a)
    bc = flat_c - np.stack([flat_b, np.zeros_like(flat_b)], axis=1)
    rows = np.zeros((len(corners), 20))
    rows[:, :12] = np.concatenate([frames, -np.einsum("fij,fj->fi", frames, a)[..., None]], axis=2).reshape(
        -1, 12
    )
    rows[:, 12] = flat_b
    for column, edge in ((13, bc), (16, flat_c)):
        length = np.linalg.norm(edge, axis=1)
        rows[:, column : column + 2] = edge / length[:, None]
        rows[:, column + 2] = length
    return rows, frames


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    # A knife edge of zero thickness (two faces back to back) has no pseudonormal; zero counts as outside there.
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def _rounded_outwards(bounds: np.ndarray, dtype: type) -> np.ndarray:
    """Boxes (6, n) in the kernel's precision: low corners rounded down, high corners up, so that none shrinks."""
    cast: np.ndarray = np.ascontiguousarray(bounds, dtype=dtype)
    if cast.size and dtype is np.float32:
        cast[:3] = np.nextafter(cast[:3], dtype(-np.inf))
        cast[3:] = np.nextafter(cast[3:], dtype(np.inf))
    return cast
