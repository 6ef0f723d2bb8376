"""Speed and exactness of basis point sets, ours beside other libraries in one process.

    python benchmarks/bench_bps.py [--batches 1 32 1024 6400] [--triangles 12 60 300 5000] [--quick]

Microseconds per encode of 64 points. One thread; 64 differently scaled meshes; every encode has its own rotated pose,
because a benchmark that repeats a few poses is learnt by the branch predictor. Candidates take turns, round after
round, and the best round counts, in CPU time of this thread, so that waiting for other processes is left out; still
trust ratios, not digits. Slow candidates get a part of the batch. Exactness is checked against the float64 twin.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
import torch
import trimesh
from bps_peers import Encode, Meshes, peers, torch_brute
from record import arguments, from_tests, write
from scipy.spatial.transform import Rotation

import object_sets
from tactile_kit.shape import MeshTable, basis_points, bps_vectors

MESHES = 64
ROUND = 0.12  # s of each candidate in a round
Poses = tuple[torch.Tensor, torch.Tensor, torch.Tensor]
twin = from_tests("shape/bps_twin.py")


def nominal(triangles: int) -> trimesh.Trimesh:
    """A closed shape of 6.75 cm: box (12), cylinder (multiples of 4), torus (large squares times two)."""
    if triangles == 12:
        return trimesh.creation.box((0.0675,) * 3)
    if triangles < 1000:
        return trimesh.creation.cylinder(0.0675 / 2, 0.0675, sections=triangles // 4)
    sections = round((triangles / 2) ** 0.5)
    return trimesh.creation.torus(0.024, 0.00975, major_sections=sections, minor_sections=sections)


def scaled(mesh: trimesh.Trimesh, rng: np.random.Generator) -> Meshes:
    return [
        trimesh.Trimesh(mesh.vertices * rng.uniform(0.045, 0.09, 3) / 0.0675, mesh.faces, process=False)
        for _ in range(MESHES)
    ]


def poses(rng: np.random.Generator, batch: int, meshes: int = MESHES) -> Poses:
    R = Rotation.random(batch, rng=rng).as_matrix().astype(np.float32)
    x = rng.normal(scale=0.01, size=(batch, 3)).astype(np.float32)
    return torch.from_numpy(x), torch.from_numpy(R), torch.from_numpy(rng.integers(meshes, size=batch))


class Forward:
    """Seconds of encoding without gradients."""

    def __init__(self, encode: Encode) -> None:
        self.encode = encode

    def __call__(self, batch: Poses) -> float:
        start = time.thread_time()
        self.encode(*batch)
        return time.thread_time() - start


class Backward:
    """Seconds of our backward pass, the forward pass left out."""

    def __init__(self, table: MeshTable, rng: np.random.Generator) -> None:
        self.table, self.rng = table, rng

    def __call__(self, batch: Poses) -> float:
        x, R, mesh = batch[0].clone().requires_grad_(), batch[1].clone().requires_grad_(), batch[2]
        vectors = bps_vectors(self.table, x, R, mesh)
        gradient = torch.from_numpy(self.rng.normal(size=vectors.shape).astype(np.float32))
        start = time.thread_time()
        torch.autograd.grad(vectors, (x, R), gradient)
        return time.thread_time() - start


class WarpBackward:
    """Seconds of Warp's backward pass, the forward pass left out."""

    def __init__(self, warp: Any, rng: np.random.Generator) -> None:
        self.warp, self.rng = warp, rng

    def __call__(self, batch: Poses) -> float:
        gradient = torch.from_numpy(self.rng.normal(size=(len(batch[0]), 64, 3)).astype(np.float32))
        run, _, _ = self.warp.recorded(*batch, gradient)
        start = time.thread_time()
        run()
        return time.thread_time() - start


def measure(triangles: int, batch: int, rounds: int, quick: bool) -> dict[str, Any]:
    """Microseconds per encode of each candidate, best of the rounds."""
    rng = np.random.default_rng(0)
    meshes = scaled(nominal(triangles), rng)
    start = time.thread_time()
    table = MeshTable.from_meshes([(mesh.vertices, mesh.faces) for mesh in meshes])
    best: dict[str, Any] = {"build_per_mesh": (time.thread_time() - start) / MESHES * 1e6}
    assert len(table.corners) == MESHES * triangles
    others = peers(meshes) | {"torch": torch_brute(table)}
    for name, encode in others.items():
        agree(name, encode, table, rng)
    candidates: dict[str, Any] = {"ours": Forward(lambda *pose: bps_vectors(table, *pose))}
    candidates |= {name: Forward(encode) for name, encode in others.items()}
    candidates["ours backward"] = Backward(table, rng)
    if "warp" in others:
        candidates["warp backward"] = WarpBackward(others["warp"], rng)
    plan = {name: _plan(candidate, batch, rng, quick) for name, candidate in candidates.items()}
    for _ in range(rounds):
        for name, candidate in candidates.items():
            rows, calls = plan[name]
            batches = [poses(rng, rows) for _ in range(calls)]
            taken = sum(candidate(one) for one in batches) / (rows * calls) * 1e6
            best[name] = min(best.get(name, np.inf), taken)
    return {name: round(value, 3) for name, value in best.items()}


def _plan(candidate: Any, batch: int, rng: np.random.Generator, quick: bool) -> tuple[int, int]:
    """Rows and calls of a candidate in a round: the whole batch where that takes less than half a second."""
    few = poses(rng, min(batch, 32))
    candidate(few)
    cost = min(candidate(few) for _ in range(3)) / len(few[0])
    rows = min(batch, max(32, int(0.5 / cost)))
    return rows, 1 if quick else max(1, min(int(ROUND / (cost * rows)), 2000))


def agree(name: str, encode: Encode, table: MeshTable, rng: np.random.Generator) -> None:
    """A peer that answers something else is not compared. Lengths: near-ties may point elsewhere."""
    batch = poses(rng, 32)
    wanted, found = bps_vectors(table, *batch).norm(dim=-1), encode(*batch).norm(dim=-1)
    counted = wanted > 0 if name == "libigl" else torch.ones_like(wanted, dtype=torch.bool)
    error = (found - wanted).abs()[counted]
    if (error > 1e-5).double().mean() > 1e-3:
        raise SystemExit(
            f"{name} disagrees with ours: largest difference of lengths {float(error.max()):.2e} m"
        )


def hard_meshes() -> Meshes:
    """The tests' spikes, wedges and slabs."""
    return list(from_tests("shape/bps_cases.py").hard_shapes().values())


def exactness(poses_a_mesh: int) -> dict[str, Any]:
    """Distances and signs against the float64 twin: all objects, half of the poses at random extents, hard shapes.

    Signs within 1e-6 m of the surface are not counted.
    """
    rng = np.random.default_rng(1)
    objects = list(object_sets.load("all"))
    meshes = [trimesh.Trimesh(thing.vertices, thing.faces, process=False) for thing in objects]
    for thing in objects:
        other = thing.with_extents(rng.uniform(0.045, 0.09, 3))
        meshes.append(trimesh.Trimesh(other.vertices, other.faces, process=False))
    meshes += hard_meshes()
    table = MeshTable.from_meshes([(mesh.vertices, mesh.faces) for mesh in meshes])
    x, R, _ = poses(rng, poses_a_mesh * len(meshes))
    mesh = torch.arange(len(meshes)).repeat_interleave(poses_a_mesh)
    distance, inside = reference(table, x, R, mesh)
    candidates = {"ours": lambda *pose: bps_vectors(table, *pose)} | peers(meshes)
    result: dict[str, Any] = {"queries": distance.numel(), "inside": int(inside.sum())}
    for name, encode in candidates.items():
        length = encode(x, R, mesh).double().norm(dim=-1)
        clear = distance > 1e-6
        wrong = clear & ((length == 0) != inside)
        error = (length - distance).abs()[clear & ~inside & (length > 0)]
        result[name] = {
            "largest_distance_error_m": float(error.max()),
            "sign_errors": None if name == "libigl" else int(wrong.sum()),
            "deepest_sign_error_m": None if name == "libigl" else float((distance * wrong).max()),
        }
    return result


def reference(
    table: MeshTable, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Distances and insideness ``(B, 64)`` by the twin."""
    points, distances, insides = torch.from_numpy(basis_points()), [], []
    for position, rotation, index in zip(x.double(), R.double(), mesh):
        posed = torch.from_numpy(table.triangles(int(index))) @ rotation.T + position
        distances.append((twin.closest_points(points, posed) - points).norm(dim=-1))
        insides.append(twin.inside(points, posed))
    return torch.stack(distances), torch.stack(insides)


def main() -> None:
    def add(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("--batches", type=int, nargs="+", default=[1, 32, 1024, 6400])
        parser.add_argument("--triangles", type=int, nargs="+", default=[12, 60, 300, 5000])

    options = arguments(__doc__ or "", add)
    torch.set_num_threads(1)
    rows = []
    for triangles in options.triangles:
        for batch in options.batches:
            row = measure(triangles, batch, 1 if options.quick else 5, options.quick)
            rows.append({"triangles": triangles, "batch": batch, **row})
            print(rows[-1], flush=True)
    results = {
        "unit": "microseconds per encode of 64 points, one thread",
        "rows": rows,
        "exactness": exactness(2 if options.quick else 40),
    }
    packages = ("numpy", "numba", "torch", "warp-lang", "open3d-cpu", "open3d", "libigl", "trimesh")
    write("bps", results, options, packages)


if __name__ == "__main__":
    main()
