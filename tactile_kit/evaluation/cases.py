"""What an evaluation consists of: cases (object held, mesh given, goals) and their episodes, each with its own seed.

Seeds and goals depend on the object, its size, the goal and the repeat only, never on the agent or the mesh given. So two
agents, or the right and a wrong mesh, meet the very same episodes, and their difference carries less noise.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

import randomization
from tactile_kit.evaluation.errors import EvaluationError

if TYPE_CHECKING:
    from object_sets import Object

GOALS = 24  # the octahedral group; paper, Sec. III-C
EXTENT_RANGE = (0.045, 0.09)  # m; paper, Fig. 4
MEDIAN_EXTENT = 0.0675  # m; paper, Fig. 9

Given = Literal["true", "nominal", "each"]
Scaling = Literal["nominal", "random"]


@dataclass(frozen=True)
class Case:
    """One object in one size, with the mesh the agent is told of and the goals it is given.

    ``goals``: indices into ``rotations.octahedral()``, or -1 for goals drawn on SO(3).
    """

    held: Object
    size: int
    given: Object
    goals: tuple[int, ...]


class Episode(NamedTuple):
    """One episode of an evaluation: its case (index), goal index, repeat and seed."""

    case: int
    goal: int
    repeat: int
    seed: int


def make_cases(
    objects: Iterable[Object],
    *,
    scaling: Scaling = "nominal",
    sizes: int = 1,
    given: Given | Object = "true",
    goals: Literal["octahedral", "so3"] = "octahedral",
    goals_per_case: int = GOALS,
    seed: int = 0,
) -> list[Case]:
    """The cases of an evaluation, object by object, size by size, mesh by mesh.

    Args:
        scaling: ``nominal`` sizes, or ``random``: extents U[4.5, 9] cm, each axis on its own, ``sizes`` times an object.
        given: ``true``: the mesh of the object held; ``nominal``: that object with extents of 6.75 cm on all axes (the
            paper's fixed median mesh, Fig. 9); ``each``: one case for each of ``objects`` as the mesh (Fig. 10); or an
            object: its mesh always.
        goals_per_case: how many of the 24 goals, drawn without repetition; all of them by default.

    Raises:
        EvaluationError: naming the argument, its value and what is allowed.
    """
    objects = list(objects)
    if not objects:
        raise EvaluationError("objects = []; at least one is needed")
    if sizes < 1 or (scaling == "nominal" and sizes != 1):
        raise EvaluationError(f"sizes = {sizes}; allowed are integers >= 1, and 1 only where scaling is nominal")
    if scaling not in ("nominal", "random"):
        raise EvaluationError(f"scaling = {scaling!r}; allowed are 'nominal' and 'random'")
    if goals not in ("octahedral", "so3"):
        raise EvaluationError(f"goals = {goals!r}; allowed are 'octahedral' and 'so3'")
    if goals_per_case < 1 or (goals == "octahedral" and goals_per_case > GOALS):
        raise EvaluationError(f"goals_per_case = {goals_per_case}; allowed are 1 to {GOALS}, more for goals on SO(3)")
    if isinstance(given, str) and given not in ("true", "nominal", "each"):
        raise EvaluationError(f"given = {given!r}; allowed are 'true', 'nominal', 'each' or an object")
    cases = []
    for item in objects:
        for size in range(sizes):
            held = item if scaling == "nominal" else _resized(item, size, seed)
            chosen = _goals(item, size, goals, goals_per_case, seed)
            meshes = {
                "true": lambda held=held: [held],
                "nominal": lambda item=item: [item.with_extents((MEDIAN_EXTENT,) * 3)],
                "each": lambda: objects,
            }[given]() if isinstance(given, str) else [given]
            cases += [Case(held, size, mesh, chosen) for mesh in meshes]
    return cases


def make_episodes(cases: Iterable[Case], episodes_per_goal: int, seed: int) -> list[Episode]:
    """All episodes of the cases, in a fixed order. Seeds live in the stream ``evaluation``, apart from training's."""
    if episodes_per_goal < 1:
        raise EvaluationError(f"episodes_per_goal = {episodes_per_goal}; allowed are integers >= 1")
    episodes = []
    for index, case in enumerate(cases):
        for place, goal in enumerate(case.goals):
            for repeat in range(episodes_per_goal):
                name = goal if goal >= 0 else f"so3 {place}"
                child = randomization.derive(seed, "evaluation", case.held.name, case.size, name, repeat)
                episodes.append(Episode(index, goal, repeat if goal >= 0 else place * episodes_per_goal + repeat, child))
    return episodes


def _resized(item: Object, size: int, seed: int) -> Object:
    draw = randomization.stream(seed, "evaluation", "extents", item.name, size)
    return item.with_extents(draw.uniform(*EXTENT_RANGE, size=3))


def _goals(item: Object, size: int, goals: str, count: int, seed: int) -> tuple[int, ...]:
    if goals == "so3":
        return (-1,) * count
    if count == GOALS:
        return tuple(range(GOALS))
    draw = randomization.stream(seed, "evaluation", "goals", item.name, size)
    return tuple(sorted(int(i) for i in draw.choice(GOALS, size=count, replace=False)))


def goal_rotation(episode: Episode) -> np.ndarray:
    """(3, 3) float64: the goal orientation of an episode in the hand frame."""
    from tactile_kit.task import rotations

    if episode.goal >= 0:
        return rotations.octahedral()[episode.goal]
    return rotations.random_rotations(randomization.stream(episode.seed, "goal"), 1)[0]
