"""From a checked mesh to a prepared object: parts, errors, the npz and its entry in the manifest."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version
from typing import NamedTuple

import numpy as np

from object_sets.decomposition import DecompositionConfig, decompose, is_convex
from object_sets.errors import MeshError
from object_sets.importing import Alignment, Center
from object_sets.manifest import Decomposition, Entry, Errors, Part
from object_sets.mass import mass_properties
from object_sets.objects import Object
from object_sets.quality import part_errors
from object_sets.soundness import surface
from object_sets.storage import npz_bytes, sha256

MAX_DIFFERENCE = 1.0  # of the volume: parts that miss or add as much as the solid itself are refused
MAX_HAUSDORFF = 0.15  # of the largest extent: parts farther off than this are refused


@dataclass(frozen=True)
class Candidate:
    """A checked mesh on its way into a set: canonical pose, m, watertight, outward."""

    id: int
    name: str
    vertices: np.ndarray  # (V, 3) float64
    faces: np.ndarray  # (F, 3) int32
    source: str
    licence: str
    mass: float | None = None
    source_sha256: str | None = None
    center: Center = "bounding-box"
    alignment: Alignment = "none"
    repairs: tuple[str, ...] = ()
    scales: tuple[tuple[float, float, float], ...] = ()


class Prepared(NamedTuple):
    """One object, its entry in the manifest, and its npz file."""

    item: Object
    entry: Entry
    data: bytes


def prepare(
    candidate: Candidate, config: DecompositionConfig, max_difference: float = MAX_DIFFERENCE
) -> Prepared:
    """Convex parts, errors, manifest entry and npz file of one object.

    ``max_difference`` is how much volume the parts may miss or add together, relative to the solid's.

    Raises:
        DecompositionError: CoACD gave no parts.
        MeshError: the surface isn't sound, or the parts are too far from the mesh to stand for it.
    """
    from scipy.spatial import ConvexHull

    vertices, faces = candidate.vertices, candidate.faces
    surface(vertices, faces, candidate.name)
    volume = mass_properties(vertices, faces).volume
    convex = is_convex(vertices, volume)
    parts = decompose(vertices, faces, convex, config, candidate.name)
    item = Object(
        candidate.id, candidate.name, vertices, faces, parts, convex, candidate.source, candidate.licence,
        candidate.mass,
    )  # fmt: skip
    errors = part_errors(item.vertices, item.faces, item.parts, config.seed)
    if errors.hausdorff > MAX_HAUSDORFF * item.extents.max():
        raise MeshError(
            candidate.name,
            f"its {len(parts)} convex parts are up to {1000 * errors.hausdorff:.1f} mm off the surface",
            f"lower the CoACD threshold ({config.threshold}) or allow more parts",
        )
    if errors.symmetric_difference > max_difference:
        raise MeshError(
            candidate.name,
            f"its {len(parts)} convex parts differ from it by {100 * errors.symmetric_difference:.0f} % of its volume; "
            f"allowed are {100 * max_difference:g}",
            f"lower the CoACD threshold ({config.threshold}) or allow more parts",
        )
    arrays = {"vertices": item.vertices, "faces": item.faces}
    data = npz_bytes({**arrays, **{f"part{i}": part for i, part in enumerate(item.parts)}})
    file = f"{candidate.name}.npz"
    entry = Entry(
        id=item.id,
        name=item.name,
        file=file,
        sha256=sha256(data),
        digest=item.digest,
        source=item.source,
        source_sha256=candidate.source_sha256,
        licence=item.licence,
        repairs=candidate.repairs,
        vertices=len(item.vertices),
        faces=len(item.faces),
        extents=_rounded(item.extents),
        volume=_rounded(item.volume),
        center=candidate.center,
        alignment=candidate.alignment,
        center_of_mass=_rounded(item.center_of_mass, floor=1e-12),
        inertia=_rounded(item.inertia, floor=1e-12),
        mass=item.mass,
        convexity="convex" if convex else "non-convex",
        hull_ratio=_rounded(volume / ConvexHull(vertices).volume),
        parts=tuple(Part(corners=len(part), volume=_rounded(ConvexHull(part).volume)) for part in item.parts),
        errors=Errors(**{key: _rounded(value, floor=1e-9) for key, value in errors._asdict().items()}),
        decomposition=Decomposition(
            method="hull" if convex else "coacd",
            threshold=config.threshold,
            max_parts=config.max_parts,
            hull_vertices=config.convex_hull_vertices if convex else config.hull_vertices,
            seed=config.seed,
        ),
        scales=candidate.scales,
    )
    return Prepared(item, entry, data)


def versions() -> dict[str, str]:
    """Of the libraries that shape the data."""
    return {name: version(name) for name in ("coacd", "manifold3d", "numpy", "scipy", "trimesh")}


def _rounded(values, floor: float = 0.0):
    """Nine significant digits: more than anyone needs, few enough to be the same on every processor."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim:
        return tuple(_rounded(item, floor) for item in array)
    return 0.0 if abs(array) <= floor else float(f"{array:.9g}")
