"""Random object sets: solids of a family, each from a random stream of its own, if wished only graspable ones."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from threading import Lock

import numpy as np

from object_sets.assembling import Progress, Task, assemble, finished
from object_sets.building import check_arguments
from object_sets.decomposition import DecompositionConfig
from object_sets.errors import DecompositionError, MeshError, ObjectSetError, UnknownObjectError, nearest
from object_sets.families import FAMILIES
from object_sets.limits import Limits
from object_sets.objects import Object
from object_sets.preparation import Candidate, Prepared, prepare

GROUP = "object_sets.graspable"  # entry points of grasp checks
EXTENT = (0.045, 0.09)  # m, the paper's training range
DRAWS = 50  # of one object, until one is graspable
LICENCE = "CC0-1.0"

GraspCheck = Callable[[Object, int], bool]  # whether a hand can hold the object; the seed makes it repeatable


def sample(
    out: str | Path,
    family: str,
    count: int,
    *,
    seed: int = 0,
    extent: tuple[float, float] = EXTENT,
    graspable: GraspCheck | None = None,
    draws: int = DRAWS,
    coacd_threshold: float = 0.05,
    max_parts: int = 8,
    timeout: float = Limits.timeout,
    memory: float = Limits.memory,
    mass: float | None = None,
    density: float | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Path:
    """Draw a set into directory ``out`` and return the path of its manifest. Same arguments, same bytes.

    Object ``i`` depends on family, seed and ``i`` only: a longer set begins with the shorter one.

    Args:
        family: "prism", "superquadric" or "csg".
        count: number of objects.
        extent: (lowest, highest) m; each axis's extent is drawn uniformly.
        graspable: a grasp check; an object that fails is drawn again, ``draws`` times at most. See ``grasp_check``.
        coacd_threshold, max_parts: of the convex parts; timeout, memory: seconds and GiB of CoACD for one object.
        mass: kg of every object; or ``density``: kg/m^3.
        jobs, progress: as in ``build``.

    Raises:
        ObjectSetError: arguments out of range, or not one object could be made.
    """
    check_arguments(extent, 0, mass, density, jobs)
    if family not in FAMILIES:
        raise UnknownObjectError(f"family = {family!r}{nearest(family, FAMILIES)}")
    if not 1 <= count <= 9999:
        raise ObjectSetError(f"count = {count!r}: 1 to 9999 are allowed")
    if draws < 1:
        raise ObjectSetError(f"draws = {draws!r}: at least 1 is needed")
    config = DecompositionConfig(
        threshold=coacd_threshold, max_parts=max_parts, seed=seed, timeout=timeout, memory=memory
    )
    alone = Lock()  # grasp checks need not be safe to run side by side

    def task(index: int) -> Task:
        name = f"{family}_{index:04d}"

        def work() -> Prepared:
            for number in range(draws):
                source = f"family {family}, seed {seed}, number {index}, draw {number}"
                if graspable is not None:
                    source += (
                        f", held by {graspable.__module__}.{getattr(graspable, '__qualname__', graspable)}"
                    )
                try:
                    vertices, faces = _drawn(family, seed, index, number, extent)
                    made = Candidate(index, name, vertices, faces, source, LICENCE)
                    prepared = prepare(finished(made, extent, 0, seed, mass, density), config)
                except DecompositionError:
                    raise  # time and memory differ between machines; what is drawn must not
                except MeshError:
                    continue  # its parts are too far off, or its surface has slivers
                if graspable is None:
                    return prepared
                with alone:
                    held = graspable(prepared.item, seed)
                if held:
                    return prepared
            wish = "with faithful parts" if graspable is None else "graspable"
            raise MeshError(name, f"none of {draws} draws is {wish}", "change the extent or the seed")

        return Task(name, work)

    tasks = [task(index) for index in range(count)]
    return assemble(
        Path(out), f"{family}-{seed}", tasks, seed=seed, extent=extent, jobs=jobs, progress=progress,
        renumber=False,
    )  # fmt: skip


def _drawn(
    family: str, seed: int, index: int, number: int, extent: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Mesh of draw ``number`` of object ``index``: vertices (V, 3) float64 m, faces (F, 3) int32."""
    from object_sets.soundness import sound_mesh

    word = int.from_bytes(hashlib.blake2s(family.encode(), digest_size=8).digest(), "little")
    stream = np.random.SeedSequence(seed, spawn_key=(word, index, number))
    generator = np.random.default_rng(stream)
    extents = generator.uniform(*extent, 3)
    solid = import_module(f"object_sets.families.{family}").draw(generator, extents)
    return sound_mesh(solid, "bounding-box", f"{family}_{index:04d}")[:2]


def grasp_check(name: str | None = None) -> GraspCheck:
    """The grasp check that an installed package offers under the entry point group ``object_sets.graspable``.

    Raises:
        ObjectSetError: none is installed, several are and ``name`` says not which, or it can't be loaded.
    """
    found: dict[str, EntryPoint] = {point.name: point for point in entry_points(group=GROUP)}
    if not found:
        raise ObjectSetError(
            f"no grasp check is installed (entry point group {GROUP!r}); the package tactile-kit brings one"
        )
    if name is None and len(found) > 1:
        raise ObjectSetError(f"several grasp checks are installed, name one: {', '.join(sorted(found))}")
    point = found.get(name) if name is not None else next(iter(found.values()))
    if point is None:
        raise ObjectSetError(f"grasp check {name!r} is not installed{nearest(name, found)}")
    try:
        return point.load()
    except (ImportError, AttributeError) as error:
        raise ObjectSetError(
            f"grasp check {point.name!r} ({point.value}) can't be loaded: {error}"
        ) from error
