"""Other ways to basis point sets, each as ``encode(x, R, mesh) -> (B, 64, 3)`` over a list of meshes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
import trimesh

from tactile_kit.shape import MeshTable, basis_points

POINTS = torch.from_numpy(basis_points()).float()
FEATURE = torch.tensor([[1, 4, 5], [2, 5, 6], [3, 4, 6]])  # of (edge, end) in the table's pseudonormals
Encode = Callable[[torch.Tensor, torch.Tensor, torch.Tensor], torch.Tensor]
Meshes = list[trimesh.Trimesh]


def peers(meshes: Meshes) -> dict[str, Encode]:
    """All libraries that are installed, by name."""
    found: dict[str, Encode] = {}
    for name, make in (
        ("warp", with_warp),
        ("open3d", with_open3d),
        ("libigl", with_libigl),
        ("trimesh", with_trimesh),
    ):
        try:
            found[name] = make(meshes)
        except ImportError:
            continue
    return found


def with_warp(meshes: Meshes) -> Encode:
    """NVIDIA Warp: bounding volume hierarchy, sign by normals."""
    from bps_warp import Warp

    return Warp(meshes)


def with_open3d(meshes: Meshes) -> Encode:
    """Open3D's ray casting scenes: closest points and occupancy, one call a mesh and batch."""
    import open3d as o3d

    scenes = []
    for mesh in meshes:
        scenes.append(o3d.t.geometry.RaycastingScene(nthreads=1))
        scenes[-1].add_triangles(
            o3d.core.Tensor(mesh.vertices.astype(np.float32)), o3d.core.Tensor(mesh.faces.astype(np.uint32))
        )

    def query(index: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = o3d.core.Tensor(q)
        closest = scenes[index].compute_closest_points(points, nthreads=1)["points"].numpy()
        return closest, scenes[index].compute_occupancy(points, nthreads=1).numpy() > 0

    return by_mesh(query)


def with_libigl(meshes: Meshes) -> Encode:
    """libigl's AABB tree, built once; no inside test."""
    import igl

    trees = []
    for mesh in meshes:
        vertices, faces = np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int64)
        tree = igl.AABB()
        tree.init(vertices, faces)
        trees.append((tree, vertices, faces))

    def query(index: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        tree, vertices, faces = trees[index]
        return tree.squared_distance(vertices, faces, q.astype(np.float64))[2].astype(np.float32), None

    return by_mesh(query)


def with_trimesh(meshes: Meshes) -> Encode:
    """trimesh: closest_point and contains."""

    def query(index: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        closest, _, _ = trimesh.proximity.closest_point(meshes[index], q)
        return closest.astype(np.float32), meshes[index].contains(q)

    return by_mesh(query)


def by_mesh(query: Callable[[int, np.ndarray], tuple[Any, Any]]) -> Encode:
    """Batched encoding from a query of one mesh: ``(index, q (N, 3)) -> closest (N, 3), inside (N,) or None``."""
    points = POINTS.numpy()

    def encode(x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        turn, which = R.numpy(), mesh.numpy()
        q = (points - x.numpy()[:, None]) @ turn
        offset = np.empty_like(q)
        order = np.argsort(which, kind="stable")
        numbers, starts = np.unique(which[order], return_index=True)
        for index, rows in zip(numbers, np.split(order, starts[1:]), strict=True):
            flat = q[rows].reshape(-1, 3)
            closest, inside = query(int(index), flat)
            part = closest - flat
            if inside is not None:
                part[inside] = 0
            offset[rows] = part.reshape(len(rows), -1, 3)
        return torch.from_numpy(offset @ turn.transpose(0, 2, 1))

    return encode


def torch_brute(table: MeshTable) -> Encode:
    """Every point against every triangle as dense torch operations (no gradient), in pieces that fit the cache.

    All meshes of the table have the same number of triangles.
    """
    offsets, rows, normals, *_ = (torch.from_numpy(array) for array in table.arrays(np.dtype(np.float32)))
    count = int(offsets[1])
    rows, normals = rows.reshape(len(table), count, 20), normals.reshape(len(table), count, 7, 3)
    frames, place = (
        rows[:, :, :12].reshape(len(table), -1, 4)[:, :, :3],
        rows[:, :, [3, 7, 11]].reshape(len(table), 1, -1),
    )

    def edges(p: torch.Tensor, t: torch.Tensor, row: torch.Tensor) -> list[tuple[torch.Tensor, ...]]:
        """Per edge ab, bc, ac: gap to its ends along it, offset across it, its direction."""
        ab, bx, by, bc, cx, cy, ac = row[..., 12:19].unbind(-1)
        pb, one, zero = p - ab, torch.ones(()), torch.zeros(())
        along = (p, pb * bx + t * by, p * cx + t * cy)
        across = (-t, pb * by - t * bx, t * cx - p * cy)
        gaps = [torch.minimum(a.clamp(min=0), length) - a for a, length in zip(along, (ab, bc, ac))]
        return list(zip(gaps, across, (one, bx, cx), (zero, by, cy)))

    def piece(x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        q = (POINTS - x[:, None]) @ R
        p, t, h = (q @ frames[mesh].transpose(1, 2) + place[mesh]).unflatten(-1, (count, 3)).unbind(-1)
        (ga, aa, *_), (gb, ab, *_), (gc, ac, *_) = edges(p, t, rows[mesh][:, None])
        nearest = torch.minimum(torch.minimum(ga * ga + aa * aa, gb * gb + ab * ab), gc * gc + ac * ac)
        on_face = torch.maximum(torch.maximum(aa, ab), ac) <= 0
        winner = torch.addcmul(nearest.masked_fill_(on_face, 0), h, h).argmin(-1)
        # from here on the winners only, (B, 64)
        p, t, h = (v.gather(2, winner[..., None])[..., 0] for v in (p, t, h))
        row = rows[mesh[:, None], winner]
        parts = [torch.stack(torch.broadcast_tensors(*values), -1) for values in zip(*edges(p, t, row))]
        which = (parts[0] ** 2 + parts[1] ** 2).argmin(-1, keepdim=True)
        face = parts[1].amax(-1) <= 0
        gap, across, dx, dy = (part.gather(-1, which)[..., 0] for part in parts)
        which = which[..., 0]
        # outward is (dy, -dx) in this frame for ab and bc, (-dy, dx) for ac, which runs the other way round
        turn = torch.where(which == 2, -1.0, 1.0)
        in_plane = torch.stack([gap * dx - turn * across * dy, gap * dy + turn * across * dx], -1)
        offset = torch.cat([in_plane.masked_fill(face[..., None], 0), -h[..., None]], -1)
        feature = FEATURE[which, (gap > 0).long() + 2 * (gap < 0).long()].masked_fill(face, 0)
        free = (offset * normals[mesh[:, None], winner, feature]).sum(-1, keepdim=True) <= 0
        frame = row[..., :12].unflatten(-1, (3, 4))[..., :3]
        return (offset[..., None, :] @ frame)[..., 0, :] @ R.transpose(1, 2) * free

    def encode(x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        step = max(1, 6000 // count)
        parts = [piece(x[i : i + step], R[i : i + step], mesh[i : i + step]) for i in range(0, len(x), step)]
        return torch.cat(parts)

    return encode
