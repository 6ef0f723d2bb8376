"""From a mesh file to an object's mesh: parsed, repaired where that is safe, aligned, scaled, centred."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np

from object_sets.errors import MeshError, ObjectSetError, ScaleError, nearest
from object_sets.parsing import FORMATS, parse

Center = Literal["bounding-box", "mass", "origin"]
Alignment = Literal["none", "y-up", "inertia", "box"]

SIZES = (0.005, 0.5)  # m; a largest extent outside is a wrong unit rather than an object for a hand
MAX_FACES = 4000  # of an object; denser meshes are simplified, since encodings and checks cost a face


@dataclass(frozen=True)
class ImportConfig:
    """How a mesh file becomes an object's mesh.

    Attributes:
        extent: (lowest, highest) m for the largest extent; a mesh outside is scaled to the nearer bound, all axes
            alike. Units in the file then don't matter. Without it lengths are metres (3MF: the file's own unit).
        max_faces: denser meshes are simplified, the surface moving by at most 1 % of the size.
        center: what becomes the origin: the middle of the bounding box, the centre of mass, or the file's own origin.
        alignment: "none": the file's axes; "y-up": its y becomes z; "inertia": principal axes along x, y, z, the
            longest first; "box": those of the smallest box around it.
    """

    extent: tuple[float, float] | None = None
    max_faces: int = MAX_FACES
    center: Center = "bounding-box"
    alignment: Alignment = "none"

    def __post_init__(self) -> None:
        if self.extent is not None and not 0 < self.extent[0] <= self.extent[1] < np.inf:
            raise ScaleError(
                f"extent = {self.extent!r}: two lengths in m with 0 < lowest <= highest are needed"
            )
        if self.max_faces < 12:
            raise ObjectSetError(f"max_faces = {self.max_faces!r}: at least 12 are needed")
        for key, valid in (("center", get_args(Center)), ("alignment", get_args(Alignment))):
            value = getattr(self, key)
            if value not in valid:
                raise ObjectSetError(f"{key} = {value!r}{nearest(value, valid)}")


class ImportedMesh(NamedTuple):
    """A sound solid from a file."""

    vertices: np.ndarray  # (V, 3) float64 m, centred and aligned as asked
    faces: np.ndarray  # (F, 3) int32, watertight, outward
    sha256: str  # of the file
    repairs: tuple[str, ...]  # what was changed, in order; empty when nothing was


def mesh_files(folder: Path, recursive: bool = False) -> list[Path]:
    """Every mesh file of a folder, sorted by name. Raises ``ObjectSetError`` when there is none."""
    if not folder.is_dir():
        raise ObjectSetError(f"{folder}: no such folder; give a folder with {', '.join(FORMATS)} files")
    found = folder.rglob("*") if recursive else folder.iterdir()
    files = sorted(path for path in found if path.suffix.lower() in FORMATS and path.is_file())
    if not files:
        hint = "" if recursive else "; folders in it are looked into when asked for (recursive)"
        raise ObjectSetError(f"{folder}: no mesh file in it; read are {', '.join(FORMATS)}{hint}")
    return files


def import_mesh(file: str | Path, config: ImportConfig) -> ImportedMesh:
    """Read one mesh file and make a sound solid of it, in this process and without bounds of memory and time.

    For files of unknown origin there is ``reading.read_mesh``; arguments and errors are the same.
    """
    from object_sets.posing import aligned
    from object_sets.repair import check_sound, sound_solid
    from object_sets.soundness import sound_mesh

    path = Path(file)
    repairs: list[str] = []
    triangles = parse(path)
    solid = sound_solid(path, triangles, config.max_faces, repairs)
    solid = aligned(solid, config.alignment)
    low, high = np.array(solid.bounding_box()).reshape(2, 3)
    factor = _scale(path, float((high - low).max()), config.extent, repairs)
    vertices, faces, moved = sound_mesh(solid.scale((factor, factor, factor)), config.center, str(path))
    if moved:
        repairs.append(f"removed slivers, the surface moving by less than {1e6 * moved:g} micrometres")
    check_sound(path, vertices, faces)
    return ImportedMesh(vertices, faces, triangles.sha256, tuple(repairs))


def _scale(path: Path, size: float, extent: tuple[float, float] | None, repairs: list[str]) -> float:
    if extent is not None:
        factor = float(np.clip(size, *extent)) / size
        if factor != 1.0:
            repairs.append(f"scaled by {factor:.6g} to a largest extent of {1000 * factor * size:.4g} mm")
        return factor
    if not SIZES[0] <= size <= SIZES[1]:
        raise MeshError(
            path, f"is {size:.4g} m large; allowed are {SIZES[0]:g} to {SIZES[1]:g} m",
            "save it in metres, or give an extent to scale to",
        )  # fmt: skip
    return 1.0
