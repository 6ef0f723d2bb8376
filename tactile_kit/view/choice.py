"""What is to be looked at: object, size, mesh given, goal, randomisation. Everything else is the evaluation's."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import object_sets
import randomization
from object_sets.storage import cache_directory, write_atomic
from randomization import PRESETS, Randomization, derive
from tactile_kit.errors import ViewError
from tactile_kit.evaluation.schedule import EXTENT_RANGE, evaluation_task
from tactile_kit.rotations import octahedral
from tactile_kit.task.goals import EpisodeSpec
from tactile_kit.task.variants import Variants, finder_of

HELD = ""  # the mesh given is that of the object held
GOALS = 24


@dataclass(frozen=True)
class Choice:
    """One episode to be played.

    Attributes:
        held: name or address of one object, as ``object_sets.select`` takes it.
        given: the object whose mesh, at nominal size, the agent is told; ``HELD``: that of the object held.
        extents: of the object held, cm; None: nominal.
        goal: which of the 24 octahedral orientations.
        preset: of the randomisation, or a YAML file.
        terms: single terms that are not the preset's: the name of the preset they come from, or a number.
        seed: of grasp, physics and noise.
    """

    held: str = "l_shape"
    given: str = HELD
    extents: tuple[float, float, float] | None = None
    goal: int = 1
    preset: str = "default"
    terms: Mapping[str, str | float] = field(default_factory=dict)
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.goal < GOALS:
            raise ViewError(f"goal = {self.goal}; allowed are 0 to {GOALS - 1}")
        low, high = (100 * limit for limit in EXTENT_RANGE)
        if self.extents is not None and not all(low <= extent <= high for extent in self.extents):
            raise ViewError(f"extents = {self.extents} cm; allowed are {low:g} to {high:g} cm")

    def physics(self) -> Randomization:
        """The preset with the single terms in place."""
        base = randomization.preset(self.preset)
        for name, source in self.terms.items():
            if name not in base.terms:
                raise ViewError(f"term {name!r}; allowed are {', '.join(base.terms)}")
            if not isinstance(source, str):
                base = base.replay({name: np.full(base.terms[name].size, float(source))})
                continue
            if source not in PRESETS:
                raise ViewError(f"{name} = {source!r}; allowed are a number and {', '.join(PRESETS)}")
            other = randomization.preset(source).terms[name]
            terms = [other if term.name == name else term for term in base.terms.values()]
            base = Randomization(f"{self.preset}, {name} of {source}", terms, base.summary)
        return base

    def task(self, trained: Any) -> Any:
        """The evaluation's task with this object and randomisation; ``trained``: the task of the agent."""
        return evaluation_task(trained, self.held, self.seed, randomization=self._preset_name())

    def _preset_name(self) -> str:
        """A task knows its randomisation by name: with single terms it gets a file of its own, named by its content."""
        if not self.terms:
            return self.preset
        physics = self.physics()
        path = cache_directory() / "view" / f"randomization-{derive(0, repr(physics.terms)):x}.yaml"
        scratch = path.with_suffix(f".{os.getpid()}.tmp.yaml")
        path.parent.mkdir(parents=True, exist_ok=True)
        randomization.write_randomization(physics, scratch)
        write_atomic(path, scratch.read_bytes())  # also over one that is damaged
        scratch.unlink()
        return str(path)

    def variants(self, task: Any) -> Variants:
        """The bodies: the object held and, where another is given, that one, which lends its mesh only.

        Raises:
            GraspError: the object can't be held at this size.
            UnknownObjectError: a name that is not there.
        """
        from tactile_kit.simulation.banks import find_banks

        held = one(self.held)
        if self.extents is not None:
            held = held.with_extents(np.array(self.extents) / 100)
        chosen = [held] if self.given == HELD else [held, one(self.given)]
        things, bank = find_banks(finder_of(task), [(thing,) for thing in chosen], quiet=True)
        return Variants(
            tuple(things), np.arange(len(things)), np.array([True] + [False] * (len(things) - 1)), bank
        )

    def spec(self) -> EpisodeSpec:
        """The episode, of ``variants``."""
        given = 0 if self.given == HELD else 1
        return EpisodeSpec(0, given, octahedral()[self.goal], derive(self.seed, "view"))


def one(name: str) -> Any:
    """The object of that name; raises ``ViewError`` where the name stands for several."""
    found = object_sets.select(name)
    if len(found) != 1:
        raise ViewError(f"{name!r} is {len(found)} objects; allowed is one, such as {found[0].name!r}")
    return found[0]
