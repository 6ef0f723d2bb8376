"""Convex parts of a solid: its own hull where it is convex, else CoACD, checked, seeded and cached by content.

A convex part stays convex under per-axis scaling, so only the nominal shape is decomposed; sizes follow by scaling.
"""

from __future__ import annotations

import logging
import signal
import subprocess
import tempfile
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

import numpy as np

from object_sets.errors import DataError, DecompositionError, ObjectSetError
from object_sets.limits import GIB, Limits, out_of_memory, start_worker, stop_worker
from object_sets.objects import content_digest
from object_sets.storage import (
    cache_directory,
    json_bytes,
    npz_bytes,
    read_npz,
    read_sealed,
    sealed,
    sha256,
    write_atomic,
)

log = logging.getLogger(__name__)

MOST_PARTS = 256  # more than this no simulator collides at a useful speed
CONVEX_TOLERANCE = 1e-4  # a mesh whose hull is larger by less than this share of volume counts as convex


@dataclass(frozen=True)
class DecompositionConfig:
    """How solids become convex parts.

    Attributes:
        threshold: CoACD's bound on the concavity of a part, relative to the object's size, 0.01-1; lower = more parts.
        max_parts: bound on their number, -1 for none; CoACD merges beyond it.
        hull_vertices: bound on the corners of a part; fewer are faster to simulate.
        seed: of CoACD's tree search.
        timeout: seconds one mesh may take; memory: GiB that CoACD's process may take.
    """

    threshold: float = 0.1
    max_parts: int = -1
    hull_vertices: int = 32
    convex_hull_vertices: int = (
        96  # of the one part of a convex object: it is the whole shape, so it may be finer
    )
    seed: int = 0
    timeout: float = 300.0
    memory: float = 4.0

    def __post_init__(self) -> None:
        if not 0.01 <= self.threshold <= 1.0:
            raise ObjectSetError(f"threshold = {self.threshold!r}: CoACD allows 0.01 to 1")
        if self.max_parts != -1 and self.max_parts < 1:
            raise ObjectSetError(
                f"max_parts = {self.max_parts!r}: allowed are -1 (no bound) and integers >= 1"
            )
        if min(self.hull_vertices, self.convex_hull_vertices) < 8:
            raise ObjectSetError(f"hull_vertices = {self.hull_vertices!r}: at least 8 are needed")
        Limits(self.memory, self.timeout)


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
        DecompositionError: CoACD crashed, ran out of time or memory, or gave no part, or more than ``MOST_PARTS``.
    """
    from object_sets.csg import GRID, hull_corners

    if convex:
        return (hull_corners(vertices, config.convex_hull_vertices),)
    path = cache_directory() / "coacd" / f"{_key(vertices, faces, config)}.npz"
    raw = _cached(path)
    if raw is None:
        arrays = _run(vertices, faces, config, name)
        raw = _corners(arrays, name)
        try:
            write_atomic(path, sealed(arrays, path.stem))
        except OSError as error:  # minutes of work are worth more than their place on the disk
            log.warning("%s: can't be kept (%s)", path, error.strerror)
    if len(raw) > MOST_PARTS:
        raise DecompositionError(
            name, f"CoACD made {len(raw)} convex parts of it; allowed are {MOST_PARTS}",
            f"raise the threshold ({config.threshold:g}) or bound the number of parts",
        )  # fmt: skip
    parts = [hull_corners(np.round(part / GRID) * GRID + 0.0, config.hull_vertices) for part in raw]
    return tuple(sorted(parts, key=lambda part: tuple(part[0])))


def _cached(path: Path) -> list[np.ndarray] | None:
    """What was computed before; a damaged file counts as absent, and is said."""
    try:
        arrays = read_sealed(path)
        return None if arrays is None else _corners(arrays, "cache")
    except (DataError, DecompositionError, OSError) as error:
        log.warning("%s: damaged, computed again (%s)", path, error)
        return None


def _corners(arrays: dict[str, np.ndarray], name: str) -> list[np.ndarray]:
    """The parts in CoACD's answer, each with at least 4 finite corners (n, 3)."""
    parts = [
        arrays.get(f"part{i}", np.zeros(0)) for i in range(int(arrays.get("count", np.zeros(1)).flat[0]))
    ]
    if not parts:
        raise DecompositionError(name, "CoACD gave no convex part", "raise the threshold, or repair the mesh")
    for part in parts:
        if part.ndim != 2 or part.shape[1] != 3 or len(part) < 4 or not np.isfinite(part).all():
            raise DecompositionError(
                name, "CoACD gave a part without a volume", "raise the threshold, or repair the mesh"
            )
    return parts


def _key(vertices: np.ndarray, faces: np.ndarray, config: DecompositionConfig) -> str:
    settings = json_bytes({**asdict(config), "timeout": None, "memory": None, "coacd": _coacd_version()})
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
    with tempfile.TemporaryDirectory(prefix="coacd-") as folder:
        source, target = Path(folder, "in.npz"), Path(folder, "out.npz")
        inputs = {
            "vertices": vertices / scale,
            "faces": faces,
            **{k: np.array(v) for k, v in settings.items()},
        }
        source.write_bytes(npz_bytes(inputs))
        bounds = [str(int(config.memory * GIB)), str(config.timeout)]
        worker = start_worker(
            "coacd_worker", [str(source), str(target), *bounds],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        )  # fmt: skip
        try:
            words = worker.communicate(timeout=config.timeout)[1].decode(errors="replace").strip()[-400:]
            code = worker.returncode
        except subprocess.TimeoutExpired:
            code, words = -signal.SIGXCPU, ""
        finally:
            stop_worker(worker)
        if code == -signal.SIGXCPU:
            raise DecompositionError(
                name, f"CoACD took longer than {config.timeout:.3g} s on {len(faces)} faces",
                "allow more time, raise the threshold, or simplify the mesh",
            )  # fmt: skip
        if out_of_memory(words):
            raise DecompositionError(
                name, f"CoACD needs more than {config.memory:g} GiB for {len(faces)} faces",
                "allow more memory, raise the threshold, or simplify the mesh",
            )  # fmt: skip
        if code != 0 or not target.exists():
            raise DecompositionError(
                name,
                f"CoACD ended with code {code}: {words or 'no message'}",
                "repair or simplify the mesh, or allow more memory",
            )
        arrays = read_npz(target.read_bytes(), target)
    return {key: value if key == "count" else value * scale for key, value in arrays.items()}
