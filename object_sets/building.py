"""Build an object set: authored shapes or a folder of meshes in, npz files and a manifest out."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from object_sets.decomposition import DecompositionConfig
from object_sets.errors import MeshError, ObjectSetError, ScaleError, UnknownObjectError, nearest
from object_sets.manifest import MANIFEST_NAME, Entry, Manifest, Refused
from object_sets.preparation import Candidate, prepare, versions
from object_sets.sets import SETS
from object_sets.storage import write_atomic

log = logging.getLogger(__name__)

Outcome = tuple[Entry, bytes] | Refused
Progress = Callable[[str, int, int], None]  # what just ended, how many are done, of how many


def build(
    out: str | Path,
    *,
    meshes: str | Path | None = None,
    set_name: str | None = None,
    extent: tuple[float, float] | None = None,
    scales: int = 0,
    seed: int = 0,
    coacd_threshold: float | None = None,
    max_parts: int | None = None,
    hull_vertices: int | None = None,
    timeout: float = DecompositionConfig.timeout,
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
        meshes: folder of mesh files (STL, OBJ, PLY, GLB/GLTF, OFF, 3MF); or
        set_name: one of the authored sets ("geometric8", "ood", "complex", "paper", "all").
        extent: (lowest, highest) side of a bounding box, m. Without ``scales``, a mesh whose largest extent is outside
            is scaled, all axes alike, to the nearer bound. With ``scales``, each axis's extent is drawn uniformly.
        scales: number of prepared sizes an object; needs ``extent``.
        seed: of the sizes and of CoACD.
        coacd_threshold, max_parts, hull_vertices, timeout: settings of the convex parts (``DecompositionConfig``);
            by default those of each authored shape, or the general ones.
        mass: kg of every object; or ``density``: kg/m^3 of the solid. By default authored masses, else unknown.
        licence: of the meshes, for the manifest.
        jobs: meshes worked on at once.
        progress: called after each object.

    Raises:
        ObjectSetError: arguments that don't fit together, or not one mesh could be used.
    """
    _check(meshes, set_name, extent, scales, mass, density, jobs)
    out = Path(out)
    given = {"threshold": coacd_threshold, "max_parts": max_parts, "hull_vertices": hull_vertices}
    settings: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    settings.update(seed=seed, timeout=timeout)
    if set_name is not None:
        tasks = _authored(set_name, settings)
        name = set_name
    else:
        assert meshes is not None
        tasks = _imported(Path(meshes), settings, extent, licence)
        name = Path(meshes).resolve().name
    outcomes: list[Outcome] = []
    # Threads are enough: the heavy work is CoACD's, in processes of its own.
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        finish = [
            (label, pool.submit(_outcome, label, task, extent, scales, seed, mass, density))
            for label, task in tasks
        ]
        for label, future in finish:
            outcomes.append(future.result())
            if progress is not None:
                progress(label, len(outcomes), len(finish))
    refused = tuple(outcome for outcome in outcomes if isinstance(outcome, Refused))
    ready = [outcome for outcome in outcomes if not isinstance(outcome, Refused)]
    if not ready:
        listing = "\n".join(f"  {r.file}: {r.defect}; remedy: {r.remedy}" for r in refused)
        raise ObjectSetError(f"{meshes or set_name}: no mesh could be used\n{listing}")
    if meshes is not None:  # without gaps where a file was refused
        ready = [(entry.model_copy(update={"id": index}), data) for index, (entry, data) in enumerate(ready)]
    manifest = Manifest(
        name=name, seed=seed, extent=extent, versions=versions(), objects=tuple(entry for entry, _ in ready),
        refused=refused,
    )  # fmt: skip
    for entry, data in ready:
        write_atomic(out / entry.file, data)
    path = out / MANIFEST_NAME
    write_atomic(path, manifest.to_bytes())  # last: a directory with a manifest is complete
    return path


Task = tuple[Callable[[], Candidate], DecompositionConfig]


def _authored(set_name: str, settings: dict[str, Any]) -> list[tuple[str, Task]]:
    from object_sets.csg import to_mesh
    from object_sets.shapes import LICENCE, SHAPES

    if set_name not in SETS:
        raise UnknownObjectError(f"set_name = {set_name!r}{nearest(set_name, SETS)}")

    def task(index: int) -> tuple[str, Task]:
        shape = SHAPES[index]
        own = {"max_parts": shape.max_parts, "hull_vertices": shape.hull_vertices}
        config = DecompositionConfig(**{**own, **settings})

        def make() -> Candidate:
            vertices, faces = to_mesh(shape.make())
            return Candidate(shape.id, shape.name, vertices, faces, shape.source, LICENCE, shape.mass)

        return shape.name, (make, config)

    return [task(index) for index in SETS[set_name]]


def _imported(
    folder: Path, settings: dict[str, Any], extent: tuple[float, float] | None, licence: str
) -> list[tuple[str, Task]]:
    from object_sets.importing import mesh_files, read_mesh

    files = mesh_files(folder)
    names = _names(files)
    config = DecompositionConfig(**settings)

    def task(index: int) -> tuple[str, Task]:
        file = files[index]

        def make() -> Candidate:
            mesh = read_mesh(file, extent)
            return Candidate(
                index, names[index], mesh.vertices, mesh.faces, file.name, licence,
                source_sha256=mesh.sha256, repairs=mesh.repairs,
            )  # fmt: skip

        return str(file), (make, config)

    return [task(index) for index in range(len(files))]


def _outcome(
    label: str,
    task: Task,
    extent: tuple[float, float] | None,
    scales: int,
    seed: int,
    mass: float | None,
    density: float | None,
) -> Outcome:
    from object_sets.mass import mass_properties

    make, config = task
    try:
        candidate = make()
        if mass is not None or density is not None:
            volume = mass_properties(candidate.vertices, candidate.faces).volume
            candidate = replace(candidate, mass=mass if density is None else density * volume)
        if extent is not None and scales:
            sides = np.ptp(candidate.vertices, axis=0)
            candidate = replace(candidate, scales=draw_scales(sides, extent, scales, seed, candidate.name))
        return prepare(candidate, config)
    except MeshError as error:
        log.warning("refused %s", error)
        return Refused(file=error.file, defect=error.defect, remedy=error.remedy)
    except ObjectSetError as error:
        log.warning("refused %s", error)
        return Refused(file=label, defect=str(error), remedy="see the defect")


def draw_scales(
    extents: np.ndarray, extent: tuple[float, float], count: int, seed: int, name: str
) -> tuple[tuple[float, float, float], ...]:
    """Per-axis factors of ``count`` sizes with extents (m) uniform in ``extent``, from a stream of the name's own."""
    word = int.from_bytes(hashlib.blake2s(name.encode(), digest_size=8).digest(), "little")
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(word,)))
    factors = generator.uniform(*extent, size=(count, 3)) / extents
    return tuple((float(f"{x:.9g}"), float(f"{y:.9g}"), float(f"{z:.9g}")) for x, y, z in factors)


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


def _check(
    meshes: str | Path | None,
    set_name: str | None,
    extent: tuple[float, float] | None,
    scales: int,
    mass: float | None,
    density: float | None,
    jobs: int,
) -> None:
    if (meshes is None) == (set_name is None):
        raise ObjectSetError(f"meshes = {meshes!r}, set_name = {set_name!r}: exactly one of them is needed")
    if extent is not None and not 0 < extent[0] <= extent[1] < np.inf:
        raise ScaleError(f"extent = {extent!r}: two lengths in m with 0 < lowest <= highest are needed")
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
