"""The bodies of a task: every object at its nominal size and, under random scaling, at prepared random ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import object_sets
import randomization
from object_sets import Object
from tactile_kit.simulation import batches
from tactile_kit.simulation.banks import Finder, Report, find_banks
from tactile_kit.simulation.grasps import GraspBank
from tactile_kit.task.config import TaskConfig

REDRAWS = 20  # sizes tried before one is given up: some shapes can't be held at the far ends of the range


@dataclass(frozen=True)
class Variants:
    """Objects and sizes of a task. The first ``number_of_objects`` variants are the nominal ones.

    Attributes:
        objects: every variant as an object of its own.
        object_index: ``(N,) int64``, which of the task's objects a variant is.
        playable: ``(N,) bool``, whether episodes draw it (under random scaling the nominal sizes only lend meshes).
        bank: grasps a variant.
    """

    objects: tuple[Object, ...]
    object_index: NDArray[np.int64]
    playable: NDArray[np.bool_]
    bank: GraspBank

    def __len__(self) -> int:
        return len(self.objects)

    @property
    def number_of_objects(self) -> int:
        """How many different objects there are."""
        return int(self.object_index.max()) + 1

    def of_object(self, index: int) -> NDArray[np.int64]:
        """Playable variants of object ``index``."""
        return np.flatnonzero((self.object_index == index) & self.playable)

    def nominal(self, variant: int) -> int:
        """The variant of the same object at its nominal size."""
        return int(self.object_index[variant])


@dataclass(frozen=True)
class RandomSizes(Sequence[Object]):
    """Size ``number`` of an object under random scaling: what is tried for it, each from the next stream of its name.

    Some shapes can't be held at the far ends of the range, so there is more than one.
    """

    thing: Object
    extent_range: tuple[float, float]
    seed: int
    number: int

    def __len__(self) -> int:
        return REDRAWS

    def __getitem__(self, attempt: Any) -> Any:
        if not -REDRAWS <= attempt < REDRAWS:
            raise IndexError(attempt)
        name, attempt = self.thing.name, attempt % REDRAWS
        generator = randomization.stream(self.seed, "variants", name, self.number, attempt)
        return self.thing.with_extents(generator.uniform(*self.extent_range, size=3))


def finder_of(config: TaskConfig) -> Finder:
    """What finds the grasps of a task: the physics that it is played in.

    Raises:
        EngineError: it is not installed.
    """
    return batches.finder_of(config.simulation, config.grasps, config.grasp_spread)


def prepare(
    config: TaskConfig, num_workers: int = 1, progress: Report | None = None, quiet: bool = False
) -> Variants:
    """Objects, sizes and grasps of a task; grasps come from the cache where they were found before.

    A size at which no grasp holds is drawn anew, from the next stream of its name.

    Args:
        config: the task.
        num_workers: processes that look for grasps; below 2 this one does. What they find does not depend on it.
        progress: called with (objects and sizes whose grasps are there, of how many). Without it, a search that takes
            more than a few seconds is shown on stderr.
        quiet: show nothing there.

    Raises:
        object_sets.UnknownObjectError: ``config.objects`` names something that is not there.
        GraspError: an object can't be held.
        CacheError: grasps have to be found, and the cache can't be written to.
    """
    nominal = tuple(object_sets.select(config.objects))
    choices: list[Sequence[Object]] = [(thing,) for thing in nominal]
    index, playable = list(range(len(nominal))), [config.scaling == "nominal"] * len(nominal)
    if config.scaling == "random":
        for number in range(config.variants):
            choices += [
                RandomSizes(thing, config.extent_range, config.variant_seed, number) for thing in nominal
            ]
            index += range(len(nominal))
            playable += [True] * len(nominal)
    things, bank = find_banks(finder_of(config), choices, num_workers, progress, quiet)
    return Variants(tuple(things), np.array(index), np.array(playable), bank)
