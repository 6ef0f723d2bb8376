"""What an evaluation consists of: cases (object held, mesh given, goals) and their episodes, each with its own seed.

Seeds and goals depend on the object, its size, the goal and the repeat only, never on the agent or the mesh given. So
two agents, or the right and a wrong mesh, meet the very same episodes, and their difference carries less noise.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

import randomization
from tactile_kit.errors import EvaluationError

GOALS = 24  # the octahedral group; paper, Sec. III-C


class Body(NamedTuple):
    """One body an environment has ready, in the order of its variants.

    ``size`` is 0 for the nominal size and counts the random ones from 1; ``playable`` bodies are held, all lend meshes.
    """

    name: str
    size: int
    playable: bool


@dataclass(frozen=True)
class Case:
    """One body held, the body whose mesh the agent is told of (indices of bodies), and the goals it is given.

    ``goals``: indices into ``rotations.octahedral()``, or -1 for goals drawn on SO(3).
    """

    held: int
    given: int
    goals: tuple[int, ...]


class Episode(NamedTuple):
    """One episode: its case (index), goal index, repeat and seed."""

    case: int
    goal: int
    repeat: int
    seed: int


def make_cases(
    bodies: Sequence[Body],
    names: Collection[str],
    *,
    given: str = "true",
    goals: str = "octahedral",
    goals_per_case: int = GOALS,
    seed: int = 0,
) -> list[Case]:
    """The cases of an evaluation: bodies in order, for each the meshes in order.

    Args:
        bodies: what the environment has.
        names: the objects to hold; others only lend meshes.
        given: ``true``: the mesh of the body held; ``nominal``: that object at nominal size (the paper's fixed median
            mesh, Fig. 9); ``each``: the nominal mesh of every object of ``names`` in turn (Fig. 10); or an object.
        goals: ``octahedral`` or ``so3``.
        goals_per_case: how many of the 24 goals, drawn without repetition; or how many goals on SO(3).

    Raises:
        EvaluationError: naming the argument, its value and what is allowed.
    """
    if goals not in ("octahedral", "so3"):
        raise EvaluationError(f"goals = {goals!r}; allowed are 'octahedral' and 'so3'")
    if goals_per_case < 1 or (goals == "octahedral" and goals_per_case > GOALS):
        raise EvaluationError(
            f"goals_per_case = {goals_per_case}; allowed are 1 to {GOALS}, more only for goals = 'so3'"
        )
    nominal = {body.name: index for index, body in enumerate(bodies) if body.size == 0}
    held = [index for index, body in enumerate(bodies) if body.playable and body.name in names]
    if not held:
        raise EvaluationError(f"objects = {sorted(names)}; allowed are one or more of {sorted(nominal)}")
    if given not in ("true", "nominal", "each") and given not in nominal:
        raise EvaluationError(
            f"given = {given!r}; allowed are 'true', 'nominal', 'each', {', '.join(sorted(nominal))}"
        )
    cases = []
    for index in held:
        body = bodies[index]
        if given == "true":
            meshes = [index]
        elif given == "each":
            meshes = [nominal[other] for other in nominal if other in names]
        else:
            meshes = [nominal[body.name if given == "nominal" else given]]
        chosen = _goals(body, goals, goals_per_case, seed)
        cases += [Case(index, mesh, chosen) for mesh in meshes]
    return cases


def make_episodes(
    bodies: Sequence[Body], cases: Iterable[Case], episodes_per_goal: int, seed: int
) -> list[Episode]:
    """All episodes of the cases, in a fixed order. Seeds live in the stream ``evaluation``, apart from training's."""
    if episodes_per_goal < 1:
        raise EvaluationError(f"episodes_per_goal = {episodes_per_goal}; allowed are integers >= 1")
    episodes = []
    for index, case in enumerate(cases):
        body = bodies[case.held]
        for place, goal in enumerate(case.goals):
            for repeat in range(episodes_per_goal):
                name = goal if goal >= 0 else f"so3 {place}"
                child = randomization.derive(
                    seed, "evaluation", "episode", body.name, body.size, name, repeat
                )
                number = repeat if goal >= 0 else place * episodes_per_goal + repeat
                episodes.append(Episode(index, goal, number, child))
    return episodes


def goal_rotation(episode: Episode) -> np.ndarray:
    """(3, 3) float64: the goal orientation of an episode in the hand frame."""
    from tactile_kit import rotations

    if episode.goal >= 0:
        return rotations.octahedral()[episode.goal]
    return rotations.random_rotations(randomization.stream(episode.seed, "goal"), 1)[0]


def _goals(body: Body, goals: str, count: int, seed: int) -> tuple[int, ...]:
    if goals == "so3":
        return (-1,) * count
    if count == GOALS:
        return tuple(range(GOALS))
    draw = randomization.stream(seed, "evaluation", "goals", body.name, body.size)
    return tuple(sorted(int(i) for i in draw.choice(GOALS, size=count, replace=False)))
