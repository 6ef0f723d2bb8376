"""Build an object set: authored shapes or a folder of meshes in, npz files and a manifest out."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from object_sets.assembling import Progress, Task, assemble, finished
from object_sets.decomposition import DecompositionConfig
from object_sets.errors import ObjectSetError, ScaleError, UnknownObjectError, nearest
from object_sets.importing import MAX_FACES, Alignment, Center, ImportConfig, Unit, check_extent, mesh_files
from object_sets.limits import Limits
from object_sets.preparation import MAX_DIFFERENCE, Candidate, Prepared, prepare
from object_sets.reading import Readers
from object_sets.sets import SETS

Finish = Callable[[Candidate], Candidate]


def build(
    out: str | Path,
    *,
    meshes: str | Path | None = None,
    set_name: str | None = None,
    recursive: bool = False,
    extent: tuple[float, float] | None = None,
    scales: int = 0,
    center: Center = "bounding-box",
    alignment: Alignment = "none",
    max_faces: int = MAX_FACES,
    units: Unit = "m",
    remesh: bool = False,
    seed: int = 0,
    coacd_threshold: float | None = None,
    max_parts: int | None = None,
    hull_vertices: int | None = None,
    max_part_error: float = MAX_DIFFERENCE,
    timeout: float = Limits.timeout,
    memory: float = Limits.memory,
    mass: float | None = None,
    density: float | None = None,
    licence: str = "unknown",
    jobs: int = 1,
    progress: Progress | None = None,
) -> Path:
    """Build a set into directory ``out`` and return the path of its manifest. Same arguments, same bytes.

    A mesh file that can't become an object never stops the others: it is listed in the manifest's ``refused`` with
    its defect and the remedy. Convex parts come from the cache where they were made before, so a build that was
    interrupted goes on where it was.

    Args:
        out: directory; made when missing, files of the same names are replaced.
        meshes: folder of mesh files (STL, OBJ, PLY, GLB/GLTF, OFF, 3MF), with ``recursive`` its folders too; or
        set_name: one of the authored sets ("geometric8", "ood", "complex", "paper", "all").
        extent: (lowest, highest) side of a bounding box, m. Without ``scales``, a mesh whose largest extent is outside
            is scaled, all axes alike, to the nearer bound. With ``scales``, each axis's extent is drawn uniformly.
        scales: number of prepared sizes an object; needs ``extent``.
        center, alignment, max_faces, units, remesh: of meshes, see ``importing.ImportConfig``.
        seed: of the sizes and of CoACD.
        coacd_threshold, max_parts, hull_vertices: settings of the convex parts (``DecompositionConfig``); by default
            those of each authored shape, or the general ones.
        max_part_error: how much volume the convex parts may miss and add together, relative to the solid's, 0 to 1;
            what differs by more is refused.
        timeout: seconds one mesh may take: reading, repair and convex parts together.
        memory: GiB that a process working on one mesh may take.
        mass: kg of every object; or ``density``: kg/m^3 of the solid. By default authored masses, else unknown.
        licence: of the meshes, for the manifest.
        jobs: meshes worked on at once.
        progress: called after each object.

    Raises:
        ObjectSetError: arguments that don't fit together, or not one mesh could be used.
    """
    check_arguments(extent, scales, mass, density, jobs)
    if not 0 < max_part_error <= MAX_DIFFERENCE:
        raise ObjectSetError(
            f"max_part_error = {max_part_error!r}: a share of the volume, above 0 to 1, is needed"
        )
    if (meshes is None) == (set_name is None):
        raise ObjectSetError(f"meshes = {meshes!r}, set_name = {set_name!r}: exactly one of them is needed")
    posing = ImportConfig(extent, max_faces, center, alignment, units, remesh)
    if set_name is not None and posing != ImportConfig(extent):
        raise ObjectSetError(
            "center, alignment, max_faces, units and remesh are for meshes; authored shapes have their own"
        )
    given = {"threshold": coacd_threshold, "max_parts": max_parts, "hull_vertices": hull_vertices}
    settings: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    settings.update(seed=seed, timeout=timeout, memory=memory)

    def finish(candidate: Candidate) -> Candidate:
        return finished(candidate, extent, scales, seed, mass, density)

    with Readers() as readers:
        if meshes is None:
            assert set_name is not None
            name, tasks = set_name, _authored(set_name, settings, finish, max_part_error)
        else:
            name = Path(meshes).resolve().name
            tasks = _imported(
                Path(meshes), recursive, settings, posing, licence, finish, readers, max_part_error
            )
        return assemble(
            Path(out), name, tasks, seed=seed, extent=extent, jobs=jobs, progress=progress,
            renumber=meshes is not None,
        )  # fmt: skip


def _authored(set_name: str, settings: dict[str, Any], finish: Finish, max_part_error: float) -> list[Task]:
    from object_sets.csg import to_mesh
    from object_sets.shapes import LICENCE, SHAPES

    if set_name not in SETS:
        raise UnknownObjectError(f"set_name = {set_name!r}{nearest(set_name, SETS)}")

    def task(index: int) -> Task:
        shape = SHAPES[index]
        own = {"max_parts": shape.max_parts, "hull_vertices": shape.hull_vertices}
        config = DecompositionConfig(**{**own, **settings})

        def work() -> Prepared:
            vertices, faces = to_mesh(shape.make())
            made = Candidate(shape.id, shape.name, vertices, faces, shape.source, LICENCE, shape.mass)
            return prepare(finish(made), config, max_part_error)

        return Task(shape.name, work)

    return [task(index) for index in SETS[set_name]]


def _imported(
    folder: Path,
    recursive: bool,
    settings: dict[str, Any],
    posing: ImportConfig,
    licence: str,
    finish: Finish,
    readers: Readers,
    max_part_error: float,
) -> list[Task]:
    files = mesh_files(folder, recursive)
    labels = [file.relative_to(folder).as_posix() for file in files]
    names = _names([Path(label) for label in labels])
    config = DecompositionConfig(**settings)

    def task(index: int) -> Task:
        def work() -> Prepared:
            end = time.monotonic() + config.timeout
            mesh = readers.read(files[index], posing, Limits(config.memory, config.timeout))
            made = Candidate(
                index, names[index], mesh.vertices, mesh.faces, labels[index], licence,
                source_sha256=mesh.sha256, repairs=mesh.repairs, center=posing.center, alignment=posing.alignment,
            )  # fmt: skip
            left = replace(config, timeout=max(end - time.monotonic(), 1e-3))
            return prepare(finish(made), left, max_part_error)

        return Task(labels[index], work)

    return [task(index) for index in range(len(files))]


def _names(files: Sequence[Path]) -> list[str]:
    """A unique, file-system-safe name each: the stem, with the ending or a number where stems repeat."""
    names: list[str] = []
    for file in files:
        stem = "".join(c if c.isalnum() or c in "-_" else "_" for c in file.stem) or "mesh"
        name = stem if stem not in names else f"{stem}_{file.suffix[1:]}"
        while name in names or name == "manifest":
            name += "_"
        names.append(name)
    return names


def check_arguments(
    extent: tuple[float, float] | None,
    scales: int,
    mass: float | None,
    density: float | None,
    jobs: int,
) -> None:
    """Raise ``ObjectSetError`` for what no set can be made with."""
    check_extent(extent)
    if scales < 0 or (scales and extent is None):
        raise ScaleError(
            f"scales = {scales!r} with extent = {extent!r}: a number >= 0, and an extent when > 0"
        )
    if mass is not None and density is not None:
        raise ObjectSetError(f"mass = {mass!r}, density = {density!r}: at most one of them is allowed")
    for key, value in (("mass", mass), ("density", density)):
        if value is not None and not 0 < value < np.inf:
            raise ObjectSetError(f"{key} = {value!r}: a finite number > 0 is needed")
    if jobs < 1:
        raise ObjectSetError(f"jobs = {jobs!r}: at least 1 is needed")
