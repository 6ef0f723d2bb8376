"""Convex parts of a solid: its own hull where it is convex, else CoACD, checked, seeded and cached by content.

A convex part stays convex under per-axis scaling, so only the nominal shape is decomposed; sizes follow by scaling.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

import numpy as np

from object_sets.errors import DecompositionError
from object_sets.objects import content_digest
from object_sets.storage import cache_directory, json_bytes, npz_bytes, read_npz, sha256, write_atomic

CONVEX_TOLERANCE = 1e-4  # a mesh whose hull is larger by less than this share of volume counts as convex


@dataclass(frozen=True)
class DecompositionConfig:
    """How solids become convex parts.

    Attributes:
        threshold: CoACD's bound on the concavity of a part, relative to the object's size, 0.01-1; lower = more parts.
        max_parts: bound on their number, -1 for none; CoACD merges beyond it.
        hull_vertices: bound on the corners of a part; fewer are faster to simulate.
        seed: of CoACD's tree search.
        timeout: seconds one mesh may take.
    """

    threshold: float = 0.1
    max_parts: int = -1
    hull_vertices: int = 32
    convex_hull_vertices: int = (
        96  # of the one part of a convex object: it is the whole shape, so it may be finer
    )
    seed: int = 0
    timeout: float = 300.0

    def __post_init__(self) -> None:
        if not 0.01 <= self.threshold <= 1.0:
            raise DecompositionError(f"threshold = {self.threshold!r}: CoACD allows 0.01 to 1")
        if self.max_parts != -1 and self.max_parts < 1:
            raise DecompositionError(
                f"max_parts = {self.max_parts!r}: allowed are -1 (no bound) and integers >= 1"
            )
        if min(self.hull_vertices, self.convex_hull_vertices) < 8:
            raise DecompositionError(f"hull_vertices = {self.hull_vertices!r}: at least 8 are needed")
        if not self.timeout > 0:
            raise DecompositionError(f"timeout = {self.timeout!r}: seconds > 0 are needed")


def is_convex(vertices: np.ndarray, volume: float) -> bool:
    """Whether the hull of vertices (V, 3) m is larger than ``volume`` m^3 by less than ``CONVEX_TOLERANCE``."""
    from scipy.spatial import ConvexHull

    return volume >= (1.0 - CONVEX_TOLERANCE) * ConvexHull(vertices).volume


def decompose(
    vertices: np.ndarray, faces: np.ndarray, convex: bool, config: DecompositionConfig, name: str = "mesh"
) -> tuple[np.ndarray, ...]:
    """The corners (n, 3) float64 m of each convex part, in a fixed order (by their lowest corner).

    Args:
        vertices: (V, 3) float64 m, faces: (F, 3) int32, watertight and outward.
        convex: the solid is convex, so its hull is its only part and CoACD isn't asked.

    Raises:
        DecompositionError: CoACD crashed, ran out of time or gave nothing; the message carries its last words.
    """
    from object_sets.csg import GRID, hull_corners

    if convex:
        return (hull_corners(vertices, config.convex_hull_vertices),)
    path = cache_directory() / "coacd" / f"{_key(vertices, faces, config)}.npz"
    if path.exists():
        arrays = read_npz(path.read_bytes(), path)
    else:
        arrays = _run(vertices, faces, config, name)
        write_atomic(path, npz_bytes(arrays))
    raw = [np.round(arrays[f"part{i}"] / GRID) * GRID + 0.0 for i in range(int(arrays["count"]))]
    if not raw:
        raise DecompositionError(f"{name}: CoACD gave no part; raise the threshold ({config.threshold})")
    parts = [hull_corners(part, config.hull_vertices) for part in raw]
    return tuple(sorted(parts, key=lambda part: tuple(part[0])))


def _key(vertices: np.ndarray, faces: np.ndarray, config: DecompositionConfig) -> str:
    settings = json_bytes({**asdict(config), "timeout": None, "coacd": _coacd_version()})
    return sha256(content_digest(vertices, faces).encode() + settings)[:32]


@lru_cache(maxsize=1)
def _coacd_version() -> str:
    return version("coacd")


def _run(
    vertices: np.ndarray, faces: np.ndarray, config: DecompositionConfig, name: str
) -> dict[str, np.ndarray]:
    scale = float(np.ptp(vertices, axis=0).max())  # CoACD works on a unit-sized mesh
    settings = {
        "threshold": config.threshold,
        "max_convex_hull": config.max_parts,
        "preprocess_mode": "off",  # the mesh is a checked manifold; remeshing would only blur its edges
        "seed": config.seed,
    }
    # One thread: the tree search's result then depends on the seed alone.
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory(prefix="coacd-") as folder:
        source, target = Path(folder, "in.npz"), Path(folder, "out.npz")
        inputs = {
            "vertices": vertices / scale,
            "faces": faces,
            **{k: np.array(v) for k, v in settings.items()},
        }
        source.write_bytes(npz_bytes(inputs))
        command = [sys.executable, str(Path(__file__).with_name("coacd_worker.py")), str(source), str(target)]
        try:
            done = subprocess.run(
                command, env=environment, capture_output=True, text=True, timeout=config.timeout, check=False
            )
        except subprocess.TimeoutExpired:
            raise DecompositionError(
                f"{name}: CoACD took longer than {config.timeout:g} s on {len(faces)} faces; "
                "raise the time limit or the threshold, or simplify the mesh"
            ) from None
        if done.returncode != 0 or not target.exists():
            words = (done.stderr or done.stdout).strip()[-400:] or "no message"
            raise DecompositionError(f"{name}: CoACD ended with code {done.returncode}: {words}")
        arrays = read_npz(target.read_bytes(), target)
    return {key: value if key == "count" else value * scale for key, value in arrays.items()}
