"""Speed of basis point sets, ours beside peers in one process: microseconds per encode of 64 points.

    python benchmarks/bps.py [--out FILE] [--batches 1 32 1024] [--triangles 12 60 300 5000] [--quick]

Prints one JSON object. One thread; 64 differently scaled meshes; every encode has its own rotated pose, because a
benchmark that repeats a few poses is learnt by the branch predictor. Candidates take turns, round after round, and the
best round counts, in CPU time of this thread, so that waiting for other processes is left out; still trust ratios, not
digits. Peers: brute force in torch over the same tables, and trimesh (closest_point and contains); that their
distances and signs agree with ours is checked before timing.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numba
import numpy as np
import torch
import trimesh
from scipy.spatial.transform import Rotation

from tactile_kit.shape import MeshTable, basis_points, bps_vectors

MESHES = 64
POINTS = torch.from_numpy(basis_points()).float()
FEATURE = torch.tensor([[1, 4, 5], [2, 5, 6], [3, 4, 6]])  # of (edge, end) in the table's pseudonormals
Poses = tuple[torch.Tensor, torch.Tensor, torch.Tensor]
Encode = Callable[..., torch.Tensor]


def nominal(triangles: int) -> trimesh.Trimesh:
    """A closed shape of 6.75 cm: box (12), cylinder (multiples of 4), torus (large squares times two)."""
    if triangles == 12:
        return trimesh.creation.box((0.0675,) * 3)
    if triangles < 1000:
        return trimesh.creation.cylinder(0.0675 / 2, 0.0675, sections=triangles // 4)
    sections = round((triangles / 2) ** 0.5)
    return trimesh.creation.torus(0.024, 0.00975, major_sections=sections, minor_sections=sections)


def scaled(mesh: trimesh.Trimesh, rng: np.random.Generator) -> list[trimesh.Trimesh]:
    return [
        trimesh.Trimesh(mesh.vertices * rng.uniform(0.045, 0.09, 3) / 0.0675, mesh.faces, process=False)
        for _ in range(MESHES)
    ]


def poses(rng: np.random.Generator, calls: int, batch: int) -> list[Poses]:
    R = Rotation.random(calls * batch, rng=rng).as_matrix().astype(np.float32).reshape(calls, batch, 3, 3)
    x = rng.normal(scale=0.01, size=(calls, batch, 3)).astype(np.float32)
    mesh = rng.integers(MESHES, size=(calls, batch))
    return [(torch.from_numpy(a), torch.from_numpy(b), torch.from_numpy(c)) for a, b, c in zip(x, R, mesh)]


def torch_brute(table: MeshTable) -> Encode:
    """Every point against every triangle as dense torch operations (no gradient), in pieces that fit the cache."""
    offsets, rows, normals, *_ = (torch.from_numpy(array) for array in table.arrays(np.dtype(np.float32)))
    count = int(offsets[1])
    rows, normals = rows.reshape(MESHES, count, 20), normals.reshape(MESHES, count, 7, 3)
    frames, place = (
        rows[:, :, :12].reshape(MESHES, -1, 4)[:, :, :3],
        rows[:, :, [3, 7, 11]].reshape(MESHES, 1, -1),
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


def with_trimesh(meshes: list[trimesh.Trimesh]) -> Encode:
    def one(x: np.ndarray, R: np.ndarray, mesh: trimesh.Trimesh) -> np.ndarray:
        q = (POINTS.numpy() - x) @ R
        closest, _, _ = trimesh.proximity.closest_point(mesh, q)
        return np.where(mesh.contains(q)[:, None], 0.0, (closest - q) @ R.T)

    def encode(x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        return torch.from_numpy(
            np.stack([one(*pose, meshes[i]) for *pose, i in zip(x.numpy(), R.numpy(), mesh)])
        )

    return encode


def check(name: str, encode: Encode, table: MeshTable, rng: np.random.Generator) -> None:
    """A peer that answers something else is not compared. Lengths: near-ties may point elsewhere."""
    batch = poses(rng, 1, 32)[0]
    error = (encode(*batch).norm(dim=-1) - bps_vectors(table, *batch).norm(dim=-1)).abs()
    if (error > 1e-5).double().mean() > 1e-3:
        raise SystemExit(
            f"{name} disagrees with ours: largest difference of lengths {float(error.max()):.2e} m"
        )


def seconds(encode: Encode, batches: list[Poses]) -> float:
    start = time.thread_time()
    for batch in batches:
        encode(*batch)
    return time.thread_time() - start


def backward_seconds(table: MeshTable, batches: list[Poses], gradient: torch.Tensor) -> float:
    total = 0.0
    for x, R, mesh in batches:
        x, R = x.requires_grad_(), R.requires_grad_()
        vectors = bps_vectors(table, x, R, mesh)
        start = time.thread_time()
        torch.autograd.grad(vectors, (x, R), gradient)
        total += time.thread_time() - start
        x.requires_grad_(False), R.requires_grad_(False)
    return total


def measure(triangles: int, batch: int, encodes: int, rounds: int) -> dict[str, float]:
    """Microseconds per encode of each candidate, best of the rounds."""
    rng = np.random.default_rng(0)
    meshes = scaled(nominal(triangles), rng)
    start = time.thread_time()
    table = MeshTable.from_meshes([(mesh.vertices, mesh.faces) for mesh in meshes])
    build = time.thread_time() - start
    assert len(table.corners) == MESHES * triangles
    # Slow candidates get fewer encodes, at least one call.
    shares = {"ours": (lambda *p: bps_vectors(table, *p), 1.0)}
    shares["torch"] = (torch_brute(table), min(1.0, 6 / triangles))
    shares["trimesh"] = (with_trimesh(meshes), 0.004)
    for name, (encode, _) in shares.items():
        check(name, encode, table, rng)
    gradient = torch.from_numpy(rng.normal(size=(batch, 64, 3)).astype(np.float32))
    best: dict[str, float] = {"build_per_mesh": build / MESHES * 1e6}
    for _ in range(rounds):
        batches = poses(rng, max(1, encodes // batch), batch)
        for name, (encode, share) in shares.items():
            some = batches[: max(1, int(len(batches) * share))]
            if name == "trimesh":
                some = [tuple(part[:32] for part in some[0])] if batch > 32 else some
            count = sum(len(x) for x, _, _ in some)
            best[name] = min(best.get(name, np.inf), seconds(encode, some) / count * 1e6)
        some = batches[: max(1, 2000 // batch)]
        taken = backward_seconds(table, some, gradient) / (len(some) * batch) * 1e6
        best["ours_backward"] = min(best.get("ours_backward", np.inf), taken)
    return {name: round(value, 3) for name, value in best.items()}


def machine() -> dict[str, str | int]:
    model = "unknown"
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(
            (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), model
        )
    versions = {"python": platform.python_version(), "numpy": np.__version__, "numba": numba.__version__}
    versions |= {"torch": torch.__version__, "trimesh": trimesh.__version__}
    return {"cpu": model, "threads": 1, "date": datetime.now(UTC).isoformat(timespec="seconds"), **versions}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--batches", type=int, nargs="+", default=[1, 32, 1024])
    parser.add_argument("--triangles", type=int, nargs="+", default=[12, 60, 300, 5000])
    parser.add_argument("--quick", action="store_true", help="a few encodes only, to see that it runs")
    parser.add_argument("--out", type=Path, help="also write the JSON there")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    rows = []
    for triangles in arguments.triangles:
        for batch in arguments.batches:
            encodes = 64 if arguments.quick else (6400 if triangles < 1000 else 2048)
            row = measure(triangles, batch, encodes, rounds=1 if arguments.quick else 5)
            rows.append({"triangles": triangles, "batch": batch, **row})
            print(rows[-1], file=sys.stderr, flush=True)
    text = json.dumps(
        {"benchmark": "bps", "unit": "microseconds per encode", "machine": machine(), "rows": rows}, indent=1
    )
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
