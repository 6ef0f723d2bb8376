"""Run the making of many objects, keep what went well, name what did not, and write the set."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from object_sets.errors import DataError, MeshError, ObjectSetError
from object_sets.limits import stop_all_workers
from object_sets.manifest import MANIFEST_NAME, Entry, Manifest, Refused
from object_sets.mass import mass_properties
from object_sets.preparation import Candidate, Prepared, versions
from object_sets.storage import cache_directory, check_writable, write_atomic

log = logging.getLogger(__name__)

Progress = Callable[[str, int, int], None]  # what just ended, how many are done, of how many


class Task(NamedTuple):
    """One object to make: what to call it when it fails, and the work, which raises ``ObjectSetError``."""

    label: str
    work: Callable[[], Prepared]


def assemble(
    out: Path,
    name: str,
    tasks: Sequence[Task],
    *,
    seed: int,
    extent: tuple[float, float] | None,
    jobs: int,
    progress: Progress | None,
    renumber: bool,
) -> Path:
    """Run the tasks, ``jobs`` at once, and write the set; returns the manifest's path.

    With ``renumber`` ids count on without gaps where a task was refused.

    Raises:
        ObjectSetError: not one task went well, or ``out`` or the cache can't be written to, found before any starts.
    """
    check_writable(out, "output")
    check_writable(cache_directory(), "cache")
    before = _files_of(out)
    ready: list[tuple[Entry, bytes]] = []
    refused: list[Refused] = []
    # Threads are enough: the heavy work is done in processes of its own.
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        futures = [pool.submit(_outcome, task) for task in tasks]
        try:
            for done, (task, future) in enumerate(zip(tasks, futures, strict=True), 1):
                outcome = future.result()
                if isinstance(outcome, Refused):
                    refused.append(outcome)
                else:
                    ready.append((outcome.entry, outcome.data))
                if progress is not None:
                    progress(task.label, done, len(tasks))
        except BaseException:  # an interrupt waits neither for what is under way nor for what is to come
            pool.shutdown(wait=False, cancel_futures=True)
            stop_all_workers()
            raise
    if not ready:
        listing = "\n".join(f"  {r.file}: {r.defect}; remedy: {r.remedy}" for r in refused)
        raise ObjectSetError(f"{name}: no object could be made\n{listing}")
    if renumber:
        ready = [(entry.model_copy(update={"id": index}), data) for index, (entry, data) in enumerate(ready)]
    manifest = Manifest(
        name=name, seed=seed, extent=extent, versions=versions(), objects=tuple(entry for entry, _ in ready),
        refused=tuple(refused),
    )  # fmt: skip
    for entry, data in ready:
        write_atomic(out / entry.file, data)
    path = out / MANIFEST_NAME
    write_atomic(path, manifest.to_bytes())  # last: a directory with a manifest is complete
    for name in before - {entry.file for entry, _ in ready}:
        (out / name).unlink(missing_ok=True)
    return path


def _files_of(out: Path) -> set[str]:
    """Files of a set that is there already, which the new one replaces."""
    old = out / MANIFEST_NAME
    if not old.exists():
        return set()
    try:
        return {entry.file for entry in Manifest.from_bytes(old.read_bytes(), old).objects}
    except (DataError, OSError) as error:
        raise ObjectSetError(
            f"output {out}: holds another set, and which files are its can't be told ({error})"
        ) from error


def _outcome(task: Task) -> Prepared | Refused:
    try:
        return task.work()
    except MeshError as error:
        log.info("refused %s", error)  # the manifest names it
        return Refused(file=task.label, defect=error.defect, remedy=error.remedy)
    except Exception as error:  # one object must never stop the others, whatever is wrong with it
        log.exception("failed at %s", task.label)
        return Refused(
            file=task.label, defect=f"made the program fail ({type(error).__name__}: {error})",
            remedy="repair the mesh; please report the failure",
        )  # fmt: skip


def finished(
    candidate: Candidate,
    extent: tuple[float, float] | None,
    scales: int,
    seed: int,
    mass: float | None,
    density: float | None,
) -> Candidate:
    """The candidate with its mass (kg, or from ``density`` kg/m^3) and its prepared sizes."""
    if mass is not None or density is not None:
        volume = mass_properties(candidate.vertices, candidate.faces).volume
        candidate = replace(candidate, mass=mass if density is None else density * volume)
    if extent is not None and scales:
        sides = np.ptp(candidate.vertices, axis=0)
        candidate = replace(candidate, scales=draw_scales(sides, extent, scales, seed, candidate.name))
    return candidate


def draw_scales(
    extents: np.ndarray, extent: tuple[float, float], count: int, seed: int, name: str
) -> tuple[tuple[float, float, float], ...]:
    """Per-axis factors of ``count`` sizes with extents (m) uniform in ``extent``, from a stream of the name's own."""
    word = int.from_bytes(hashlib.blake2s(name.encode(), digest_size=8).digest(), "little")
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(word,)))
    factors = generator.uniform(*extent, size=(count, 3)) / extents
    return tuple((float(f"{x:.9g}"), float(f"{y:.9g}"), float(f"{z:.9g}")) for x, y, z in factors)
