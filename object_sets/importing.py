"""From a mesh file to an object's mesh: parsed, repaired where that is safe, aligned, scaled, centred."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import numpy as np

from object_sets.errors import MeshError, ObjectSetError, ScaleError, nearest
from object_sets.parsing import FORMATS, parse

if TYPE_CHECKING:
    from manifold3d import Manifold

Center = Literal["bounding-box", "mass", "origin"]
Alignment = Literal["none", "y-up", "inertia", "box"]
Unit = Literal["m", "cm", "mm", "inch"]

LENGTHS: dict[Unit, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "inch": 0.0254}  # m

SIZES = (0.005, 0.5)  # m; a largest extent outside is a wrong unit rather than an object for a hand
MAX_FACES = 4000  # of an object; denser meshes are simplified, since encodings and checks cost a face


@dataclass(frozen=True)
class ImportConfig:
    """How a mesh file becomes an object's mesh.

    Attributes:
        extent: (lowest, highest) m for the largest extent, both within ``SIZES``; a mesh outside is scaled to the
            nearer bound, all axes alike.
        units: what one of the file's lengths is: "m", "cm", "mm" or "inch"; 3MF files have a unit of their own.
        max_faces: denser meshes are simplified, the surface moving by at most 1 % of the size.
        center: what becomes the origin: the middle of the bounding box, the centre of mass, or the file's own origin.
        alignment: "none": the file's axes; "y-up": its y becomes z; "inertia": principal axes along x, y, z, the
            longest first; "box": those of the smallest box around it.
        remesh: make a new surface around what would be refused for its surface, see ``remeshing``.
    """

    extent: tuple[float, float] | None = None
    max_faces: int = MAX_FACES
    center: Center = "bounding-box"
    alignment: Alignment = "none"
    units: Unit = "m"
    remesh: bool = False

    def __post_init__(self) -> None:
        check_extent(self.extent)
        if self.max_faces < 12:
            raise ObjectSetError(f"max_faces = {self.max_faces!r}: at least 12 are needed")
        for key, valid in (
            ("center", get_args(Center)),
            ("alignment", get_args(Alignment)),
            ("units", get_args(Unit)),
        ):
            value = getattr(self, key)
            if value not in valid:
                raise ObjectSetError(f"{key} = {value!r}{nearest(value, valid)}")


def check_extent(extent: tuple[float, float] | None, name: str = "extent") -> None:
    """Raise ``ScaleError`` unless ``extent`` is None or two lengths (m) that an object for a hand can have."""
    if extent is None:
        return
    low, high = extent
    if not 0 < low <= high < np.inf:
        raise ScaleError(f"{name} = {extent!r}: two lengths in m with 0 < lowest <= highest are needed")
    if low < SIZES[0] or high > SIZES[1]:
        other = readings(high) if high > SIZES[1] else []
        hint = f"; {low:g}:{high:g} looks like {other[0]}" if other else ""
        raise ScaleError(
            f"{name} = {extent!r}: lengths from {SIZES[0]:g} to {SIZES[1]:g} m are what a hand can hold{hint}"
        )


def readings(size: float) -> list[Unit]:
    """The units in which a largest extent of ``size`` is one for a hand."""
    return [unit for unit in ("mm", "cm", "inch", "m") if SIZES[0] <= size * LENGTHS[unit] <= SIZES[1]]


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
    # A link to nothing is a file that its owner believes to be there.
    files = sorted(
        path
        for path in found
        if path.suffix.lower() in FORMATS and (path.is_file() or (path.is_symlink() and not path.exists()))
    )
    if not files:
        hint = "" if recursive else "; folders in it are looked into when asked for (recursive)"
        raise ObjectSetError(f"{folder}: no mesh file in it; read are {', '.join(FORMATS)}{hint}")
    return files


def import_mesh(file: str | Path, config: ImportConfig) -> ImportedMesh:
    """Read one mesh file and make a sound solid of it, in this process and without bounds of memory and time.

    For files of unknown origin there is ``reading.read_mesh``; arguments and errors are the same.
    """
    from object_sets.repair import remeshed_solid, sound_solid

    path = Path(file)
    triangles = parse(path)
    if path.suffix.lower() != ".3mf":
        triangles = triangles._replace(vertices=triangles.vertices * LENGTHS[config.units])
    _check_size(path, float(np.ptp(triangles.vertices[np.unique(triangles.faces)], axis=0).max()), config)
    repairs: list[str] = []
    try:
        solid = sound_solid(path, triangles, config.max_faces, repairs)
        return _posed(path, solid, config, triangles.sha256, repairs)
    except MeshError as error:
        if not config.remesh:
            raise
        repairs = []
        solid = remeshed_solid(path, triangles, config.max_faces, error.defect, repairs)
    return _posed(path, solid, config, triangles.sha256, repairs)


def _posed(
    path: Path, solid: Manifold, config: ImportConfig, sha256: str, repairs: list[str]
) -> ImportedMesh:
    """Aligned, scaled, centred, and checked once more."""
    from object_sets.posing import aligned
    from object_sets.repair import check_sound
    from object_sets.soundness import sound_mesh

    solid = aligned(solid, config.alignment)
    low, high = np.array(solid.bounding_box()).reshape(2, 3)
    factor = _scale(float((high - low).max()), config.extent, repairs)
    vertices, faces, moved = sound_mesh(solid.scale((factor, factor, factor)), config.center, str(path))
    if moved:
        repairs.append(f"removed slivers, the surface moving by less than {1e6 * moved:g} micrometres")
    check_sound(path, vertices, faces)
    return ImportedMesh(vertices, faces, sha256, tuple(repairs))


def _scale(size: float, extent: tuple[float, float] | None, repairs: list[str]) -> float:
    if extent is None:
        return 1.0
    factor = float(np.clip(size, *extent)) / size
    if factor != 1.0:
        repairs.append(f"scaled by {factor:.6g} to a largest extent of {1000 * factor * size:.4g} mm")
    return factor


def _check_size(path: Path, size: float, config: ImportConfig) -> None:
    if size == 0:
        raise MeshError(path, "all its vertices are one point", "export it again")
    if config.extent is not None or SIZES[0] <= size <= SIZES[1]:
        return
    own = size / LENGTHS[config.units]
    other = [f"{unit}: {1000 * own * LENGTHS[unit]:.4g} mm large" for unit in readings(own)]
    hint = f"say its unit ({'; '.join(other)})" if other and path.suffix.lower() != ".3mf" else "scale it"
    raise MeshError(
        path, f"is {size:.4g} m large; allowed are {SIZES[0]:g} to {SIZES[1]:g} m",
        f"{hint}, or give an extent to scale to",
    )  # fmt: skip
