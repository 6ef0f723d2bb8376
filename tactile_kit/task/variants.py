"""The bodies of a task: every object at its nominal size and, under random scaling, at prepared random ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import object_sets
import randomization
from object_sets import Object
from tactile_kit.simulation.config import MEASUREMENT_RATE
from tactile_kit.simulation.grasps import GraspBank, GraspError, grasps_of
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


def _bank(thing: Object, config: TaskConfig) -> GraspBank:
    coarse = config.simulation.plain(MEASUREMENT_RATE)
    return grasps_of([thing], config.grasps, coarse, spread=config.grasp_spread)


def _random_size(thing: Object, config: TaskConfig, number: int, attempt: int) -> Object:
    generator = randomization.stream(config.variant_seed, "variants", thing.name, number, attempt)
    return thing.with_extents(generator.uniform(*config.extent_range, size=3))


def prepare(config: TaskConfig) -> Variants:
    """Objects, sizes and grasps of a task; grasps come from the cache where they were found before.

    A size at which no grasp holds is drawn anew, from the next stream of its name.

    Raises:
        object_sets.UnknownObjectError: ``config.objects`` names something that is not there.
        GraspError: an object can't be held.
    """
    nominal = tuple(object_sets.select(config.objects))
    banks = [_bank(thing, config) for thing in nominal]
    things, index = list(nominal), list(range(len(nominal)))
    playable = [config.scaling == "nominal"] * len(nominal)
    if config.scaling == "random":
        for number in range(config.variants):
            for which, thing in enumerate(nominal):
                found, bank = _held_size(thing, config, number)
                things.append(found)
                banks.append(bank)
                index.append(which)
                playable.append(True)
    return Variants(tuple(things), np.array(index), np.array(playable), GraspBank.joined(banks))


def _held_size(thing: Object, config: TaskConfig, number: int) -> tuple[Object, GraspBank]:
    for attempt in range(REDRAWS):
        size = _random_size(thing, config, number, attempt)
        try:
            return size, _bank(size, config)
        except GraspError as error:
            last = error
    raise GraspError(
        f"{thing.name}: none of {REDRAWS} sizes in {config.extent_range} m can be held", thing.name
    ) from last
