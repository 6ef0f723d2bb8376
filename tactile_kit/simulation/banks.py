"""Banks of grasps: kept in the cache an object and size, named by all that they depend on, found by worker processes.

What is found does not depend on the number of workers: each bank is one search with a random stream of its own. A bank
is written when it is whole, so a search that was killed goes on with the next one that is missing.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from object_sets import Object
from object_sets.storage import cache_directory, json_bytes, npz_bytes, write_atomic
from tactile_kit.hand import urdf
from tactile_kit.processes import Workers
from tactile_kit.progress import Counter
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.grasps import RECIPE, Grasp, GraspBank, GraspError, find_grasps
from tactile_kit.simulation.world import World

Report = Callable[[int, int], None]  # how many banks are there, of how many
PATIENCE = 10.0  # s that a search may last before lines tell of it
FIELDS = tuple(Grasp.__annotations__)


class CacheError(ValueError):
    """The cache can't hold what is to be found."""


class Finder(Protocol):
    """A way to find the grasps of an object; it pickles as long as it has not found any.

    ``worth`` is the number of banks that pay for the start of a worker process.
    """

    worth: ClassVar[int]

    def key(self) -> list[Any]:
        """All that the grasps depend on beside the object, as JSON."""

    def find(self, thing: Object) -> Sequence[Grasp]:
        """Grasps of ``thing``, always the same ones. Raises ``GraspError`` where it can't be held."""

    def close(self) -> None:
        """Free what was needed."""


@dataclass
class BulletFinder:
    """``count`` grasps found in Bullet under ``config`` (without thick air); ``spread`` (rad) as in ``find_grasps``."""

    worth: ClassVar[int] = 1
    count: int
    config: SimulationConfig
    seed: int = 0
    spread: float = 0.0
    world: World | None = None

    def key(self) -> list[Any]:
        """See :class:`Finder`."""
        physics = self.config.model_dump(exclude={"engine", "drag"})
        return [self.count, self.seed, self.spread, physics]

    def find(self, thing: Object) -> list[Grasp]:
        """See :class:`Finder`."""
        self.world = self.world or World(self.config.plain())
        return find_grasps(self.world, thing, self.count, self.seed, spread=self.spread)

    def close(self) -> None:
        """See :class:`Finder`."""
        if self.world is not None:
            self.world.close()
            self.world = None


def bank_file(finder: Finder, thing: Object) -> Path:
    """Where the bank of ``thing`` lies or would lie."""
    settings = json.dumps([RECIPE, thing.digest, *finder.key(), urdf.hand_urdf()], sort_keys=True)
    return cache_directory() / "grasps" / f"{hashlib.sha256(settings.encode()).hexdigest()[:24]}.npz"


def save(path: Path, grasps: Sequence[Grasp]) -> None:
    """Write a bank, whole."""
    write_atomic(path, npz_bytes({name: np.stack([getattr(g, name) for g in grasps]) for name in FIELDS}))


def find_banks(
    finder: Finder,
    choices: Sequence[Sequence[Object]],
    num_workers: int = 1,
    report: Report | None = None,
    quiet: bool = False,
) -> tuple[list[Object], GraspBank]:
    """For each of ``choices`` the first object in it that can be held, and the bank over them.

    Args:
        finder: what looks for the grasps that the cache does not hold.
        choices: sizes of an object in the order in which they are tried.
        num_workers: processes that search, where they are worth their start; below 2 this process does.
        report: called with (banks there, banks in all). Without it, a search that takes its time is shown on stderr.
        quiet: show nothing there.

    Raises:
        GraspError: nothing among one of the choices can be held, or a file of the cache is damaged.
        CacheError: something has to be found, and the cache can't be written to.
    """
    things = [_known(finder, choice) for choice in choices]
    missing = [at for at, thing in enumerate(things) if thing is None]
    if missing:
        _require_writable(cache_directory() / "grasps")
        done = len(choices) - len(missing)
        counter = Counter(
            len(choices), done, "grasps", "objects and sizes", quiet or report is not None, PATIENCE
        )
        try:
            counter.show(done)
            for at, thing in _found(finder, choices, missing, num_workers):
                things[at] = thing
                done += 1
                counter.show(done)
                if report is not None:
                    report(done, len(choices))
        finally:
            counter.close()
    elif report is not None:
        report(len(choices), len(choices))
    held = [thing for thing in things if thing is not None]
    return held, GraspBank.joined([_read(bank_file(finder, thing)) for thing in held])


def _known(finder: Finder, choice: Sequence[Object]) -> Object | None:
    """What of ``choice`` the cache says can be held; None if a search has to tell."""
    for thing in choice:
        path = bank_file(finder, thing)
        if path.exists():
            return thing
        if not _refusal(path).exists():
            return None
    raise GraspError(_refused(finder, choice), choice[0].name)


def _found(finder: Finder, choices: Sequence[Sequence[Object]], missing: list[int], num_workers: int) -> Any:
    """Pairs of a place among ``choices`` and the object there that can be held, in any order."""
    count = min(num_workers, -(-len(missing) // finder.worth))
    if count > 1:
        with Workers(count, _begin, (finder,)) as workers:
            for number, thing in workers.as_they_end(_settle, [choices[at] for at in missing]):
                yield missing[number], thing
        return
    try:
        for at in missing:
            yield at, settle(finder, choices[at])
    finally:
        finder.close()


def settle(finder: Finder, choice: Sequence[Object]) -> Object:
    """The first of ``choice`` that can be held; the cache holds its bank then, and the refusals of those before it."""
    for thing in choice:
        path = bank_file(finder, thing)
        if path.exists():  # another process may have been faster
            return thing
        if _refusal(path).exists():
            continue
        try:
            save(path, finder.find(thing))
        except GraspError as error:
            write_atomic(_refusal(path), json_bytes({"refused": str(error)}))
            continue
        return thing
    raise GraspError(_refused(finder, choice), choice[0].name)


def _refusal(path: Path) -> Path:
    """Says why there is no bank, so that nobody looks for it again."""
    return path.with_suffix(".json")


def _refused(finder: Finder, choice: Sequence[Object]) -> str:
    refusal = json.loads(_refusal(bank_file(finder, choice[-1])).read_text(encoding="utf-8"))["refused"]
    if len(choice) == 1:
        return str(refusal)
    return f"{choice[0].name}: none of {len(choice)} sizes can be held; the last one: {refusal}"


def _read(path: Path) -> GraspBank:
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {name: data[name] for name in FIELDS}
    except Exception as error:  # zipfile, zlib and numpy raise a dozen kinds on broken input
        raise GraspError(f"{path}: no readable bank of grasps ({error}); delete the file") from error
    return GraspBank(**arrays, start=np.array([0, len(arrays["joints"])]))


def _require_writable(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise CacheError(
            f"{folder}: grasps have to be found and can't be kept there ({error.strerror}); make it writable, or set "
            "TACTILE_KIT_CACHE to another folder"
        ) from error


_mine: Finder  # a worker's


def _begin(finder: Finder) -> None:
    global _mine
    _mine = finder


def _settle(choice: Sequence[Object]) -> Object:
    return settle(_mine, choice)
