"""Banks of grasps: kept in the cache an object and size, named by all that they depend on, found by worker processes.

What is found does not depend on the number of workers: each bank is one search with a random stream of its own. A bank
is written when it is whole, so a search that was killed goes on with the next one that is missing. What is read is in
memory from then on: the cache may be deleted at any time.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import logging
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from object_sets import Object
from object_sets.errors import DataError
from object_sets.storage import cache_directory, read_sealed, sealed, write_atomic
from tactile_kit.hand import urdf
from tactile_kit.processes import Workers
from tactile_kit.progress import Counter
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.grasps import RECIPE, Grasp, GraspBank, GraspError, find_grasps
from tactile_kit.simulation.world import World

log = logging.getLogger(__name__)

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


class Found(NamedTuple):
    """What a search has found, whether the cache could keep it or not.

    ``refused`` says why the object can't be held, and is empty where there is a ``bank``; ``unkept``: why not in the
    cache, empty where it is.
    """

    thing: Object
    bank: GraspBank | None
    refused: str = ""
    unkept: str = ""


def find_banks(
    finder: Finder,
    choices: Sequence[Sequence[Object]],
    num_workers: int = 1,
    report: Report | None = None,
    quiet: bool = False,
) -> tuple[list[Object], GraspBank]:
    """For each of ``choices`` the first object in it that can be held, and the bank over them.

    A file of the cache that is damaged is told, and what was in it looked for again. What is found on a disk that is
    full is used all the same, and told.

    Args:
        finder: what looks for the grasps that the cache does not hold.
        choices: sizes of an object in the order in which they are tried.
        num_workers: processes that search, where they are worth their start; below 2 this process does.
        report: called with (banks there, banks in all). Without it, a search that takes its time is shown on stderr.
        quiet: show nothing there.

    Raises:
        GraspError: nothing among one of the choices can be held.
        CacheError: something has to be found, and the cache can't be written to.
    """
    found = [_known(finder, choice) for choice in choices]
    missing = [at for at, one in enumerate(found) if one is None]
    if missing:
        _require_writable(cache_directory() / "grasps")
        done, unkept = len(choices) - len(missing), ""
        counter = Counter(
            len(choices), done, "grasps", "objects and sizes", quiet or report is not None, PATIENCE
        )
        try:
            counter.show(done)
            for at, one in _found(finder, choices, missing, num_workers):
                found[at] = one
                if one.unkept and not unkept:
                    log.warning("%s; they are used, and looked for again the next time", one.unkept)
                unkept = unkept or one.unkept
                done += 1
                counter.show(done)
                if report is not None:
                    report(done, len(choices))
        finally:
            counter.close()
    elif report is not None:
        report(len(choices), len(choices))
    held = [one for one in found if one is not None and one.bank is not None]
    return [one.thing for one in held], GraspBank.joined([one.bank for one in held if one.bank is not None])


def _known(finder: Finder, choice: Sequence[Object]) -> Found | None:
    """What of ``choice`` the cache says can be held; None if a search has to tell. A damaged file is told and goes."""
    for thing in choice:
        found = _cached(finder, thing)
        if found is None or found.bank is not None:
            return found
        refused = found.refused
    raise _none_of(choice, refused)


def _cached(finder: Finder, thing: Object) -> Found | None:
    path = bank_file(finder, thing)
    try:
        arrays = read_sealed(path)
        if arrays is not None:
            return Found(thing, _bank(arrays))
        arrays = read_sealed(_refusal(path))
        if arrays is not None:
            return Found(thing, None, arrays["refused"].tobytes().decode())
    except (DataError, OSError) as problem:
        log.warning("%s: no usable grasps (%s); looks for them again", path, problem)
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
            _refusal(path).unlink(missing_ok=True)
    return None


def _found(
    finder: Finder, choices: Sequence[Sequence[Object]], missing: list[int], num_workers: int
) -> Iterator[tuple[int, Found]]:
    """Pairs of a place among ``choices`` and what was found there, in any order."""
    count = min(num_workers, -(-len(missing) // finder.worth))
    if count > 1:
        with Workers(count, _begin, (finder,)) as workers:
            for number, found in workers.as_they_end(_settle, [choices[at] for at in missing]):
                yield missing[number], found
        return
    try:
        for at in missing:
            yield at, settle(finder, choices[at])
    finally:
        finder.close()


def settle(finder: Finder, choice: Sequence[Object]) -> Found:
    """The first of ``choice`` that can be held; the cache keeps its bank, and the refusals of those before it."""
    for thing in choice:
        found = _cached(finder, thing) or _searched(finder, thing)  # another process may have been faster
        if found.bank is not None:
            return found
        refused = found.refused
    raise _none_of(choice, refused)


def _searched(finder: Finder, thing: Object) -> Found:
    path = bank_file(finder, thing)
    try:
        grasps = finder.find(thing)
    except GraspError as error:
        refused = np.frombuffer(str(error).encode(), np.uint8)
        found = Found(thing, None, str(error))
        data = sealed({"refused": refused}, _refusal(path).stem)
        path = _refusal(path)
    else:
        arrays = _stacked(grasps)
        found, data = Found(thing, _bank(arrays)), sealed(arrays, path.stem)
    try:
        write_atomic(path, data)
    except OSError as problem:  # a search is worth more than its place on the disk
        return found._replace(unkept=f"{path.parent}: grasps can't be kept there ({problem.strerror})")
    return found


def _refusal(path: Path) -> Path:
    """Says why there is no bank, so that nobody looks for it again."""
    return path.with_name(f"{path.stem}.refused.npz")


def _none_of(choice: Sequence[Object], last: str) -> GraspError:
    """What to raise where none of ``choice`` can be held; ``last``: why not the last one."""
    if len(choice) == 1:
        return GraspError(last, choice[0].name)
    said = f"{choice[0].name}: none of {len(choice)} sizes can be held; the last one: {last}"
    return GraspError(said, choice[0].name)


def _stacked(grasps: Sequence[Grasp]) -> dict[str, np.ndarray]:
    return {name: np.stack([getattr(grasp, name) for grasp in grasps]) for name in FIELDS}


def _bank(arrays: Mapping[str, np.ndarray]) -> GraspBank:
    return GraspBank(**{name: arrays[name] for name in FIELDS}, start=np.array([0, len(arrays["joints"])]))


def _require_writable(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EIO):
            return  # what is found is used without being kept
        raise CacheError(
            f"{folder}: grasps have to be found and can't be kept there ({error.strerror}); make it writable, or set "
            "TACTILE_KIT_CACHE to another folder"
        ) from error


_mine: Finder  # a worker's


def _begin(finder: Finder) -> None:
    global _mine
    _mine = finder


def _settle(choice: Sequence[Object]) -> Found:
    return settle(_mine, choice)
