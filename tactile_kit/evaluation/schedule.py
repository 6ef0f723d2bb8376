"""The episodes of an evaluation, whoever plays them: the task, who holds what, goals and seeds; results to rows."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from randomization import STANDARD_GRAVITY, derive
from tactile_kit.errors import EngineError, EvaluationError
from tactile_kit.evaluation.cases import GOALS, Body, Case, Episode, goal_rotation, make_cases, make_episodes
from tactile_kit.evaluation.rows import SUCCESS_ANGLE, EpisodeRow
from tactile_kit.simulation.engines import WORLDS, engine_of

log = logging.getLogger(__name__)

HORIZON = 100  # actions of 0.1 s: T = 10 s
WORLD = "bullet"  # the judge; others stand beside it
STEPS_PER_SECOND = engine_of(WORLD).evaluation_rate
GRASPS = 8  # initial grasps a body; episodes draw among them
EXTENT_RANGE = (0.045, 0.09)  # m; paper, Fig. 4


class Outcome(Protocol):
    """How an episode ended. Angles to the goal in rad."""

    @property
    def theta(self) -> float: ...
    @property
    def theta_min(self) -> float: ...
    @property
    def success(self) -> bool: ...
    @property
    def drop(self) -> bool: ...
    @property
    def fault(self) -> str | None: ...
    @property
    def steps(self) -> int: ...


@dataclass(frozen=True)
class Schedule:
    """All episodes of an evaluation, in the order of ``cases.make_episodes``.

    Attributes:
        task: the ``TaskConfig`` they are played under.
        variants: the prepared bodies.
        bodies, cases, episodes: see ``cases``.
        specs: what an environment needs to play each episode.
    """

    task: Any
    variants: Any
    bodies: list[Body]
    cases: list[Case]
    episodes: list[Episode]
    specs: list[Any]

    def row(
        self, number: int, outcome: Outcome, *, agent: str, kind: str, encoding: str, training_seed: int
    ) -> EpisodeRow:
        """Episode ``number`` as a row."""
        episode = self.episodes[number]
        case = self.cases[episode.case]
        held, told = self.variants.objects[case.held], self.variants.objects[case.given]
        fault = (outcome.fault or "").replace("\n", " ")
        return EpisodeRow(
            agent=agent,
            kind=kind,
            encoding=encoding,
            training_seed=training_seed,
            object_id=held.id,
            object=held.name,
            size=self.bodies[case.held].size,
            **_extents("extent", held),
            given_id=told.id,
            given=told.name,
            **_extents("given_extent", told),
            goal=episode.goal,
            episode=episode.repeat,
            seed=episode.seed,
            theta=None if fault else outcome.theta,
            theta_min=None if fault else outcome.theta_min,
            success=outcome.success and not fault,
            drop=outcome.drop,
            fault=fault,
            steps=outcome.steps,
            world=self.task.simulation.engine,
        )


def schedule(
    trained: Any,
    objects: str | Path | Sequence[str | Path] = "paper",
    *,
    goals: str = "octahedral",
    episodes_per_goal: int = 1,
    seed: int = 0,
    given: str = "true",
    scaling: str = "nominal",
    sizes: int = 1,
    goals_per_case: int = GOALS,
    randomization: str = "default",
    world: str = WORLD,
    steps_per_second: int | None = None,
    num_workers: int = 1,
    quiet: bool = False,
) -> Schedule:
    """The episodes of an evaluation; arguments and errors as of ``evaluate``, ``trained`` as of ``evaluation_task``.

    Grasps that are not in the cache are found by ``num_workers`` processes.
    """
    import object_sets
    from tactile_kit.task.goals import EpisodeSpec

    objects = object_sets.listed(objects)
    if sizes < 1 or (scaling == "nominal" and sizes != 1):
        raise EvaluationError(
            f"sizes = {sizes}; allowed are integers >= 1, and 1 only where scaling is nominal"
        )
    if goals not in ("octahedral", "so3"):
        raise EvaluationError(f"goals = {goals!r}; allowed are 'octahedral' and 'so3'")
    lent = "" if given in ("true", "nominal", "each") else given

    def task_of(objects: str) -> Any:
        return evaluation_task(
            trained,
            f"{objects},{lent}" if lent else objects,
            seed,
            scaling,
            sizes,
            goals=goals,
            randomization=randomization,
            world=world,
            steps_per_second=steps_per_second,
        )

    objects, task, variants = _held(objects, task_of, num_workers, quiet)
    names = [thing.name for thing in object_sets.select(objects)]
    bodies = _bodies(variants)
    if lent:
        (lent,) = (thing.name for thing in object_sets.select(lent))
    cases = make_cases(
        bodies, set(names), given=lent or given, goals=goals, goals_per_case=goals_per_case, seed=seed
    )
    episodes = make_episodes(bodies, cases, episodes_per_goal, seed)
    specs = [EpisodeSpec(cases[e.case].held, cases[e.case].given, goal_rotation(e), e.seed) for e in episodes]
    return Schedule(task, variants, bodies, cases, episodes, specs)


def _held(objects: str, task_of: Callable[[str], Any], num_workers: int, quiet: bool) -> tuple[str, Any, Any]:
    """Those of the objects that can be held, their task and its variants; the others are said, and have no episodes.

    Raises ``EvaluationError`` where none is left.
    """
    from object_sets.sets import addresses
    from tactile_kit.simulation.grasps import GraspError
    from tactile_kit.task.variants import prepare

    left: dict[str, Any] = {}
    while True:
        task = task_of(objects)
        try:
            return objects, task, prepare(task, num_workers, quiet=quiet)
        except GraspError as error:
            left = left or addresses(objects)
            kept = {place: thing for place, thing in left.items() if thing.name != error.thing}
            if not kept or len(kept) == len(left):  # or it is lent, and nothing works without its mesh
                raise EvaluationError(f"nothing can be evaluated: {error}") from error
            log.warning("left out of the evaluation: %s", error)
            left, objects = kept, ",".join(kept)


def evaluation_task(
    trained: Any,
    objects: str,
    seed: int,
    scaling: str = "nominal",
    sizes: int = 1,
    *,
    goals: str = "octahedral",
    randomization: str = "default",
    world: str = WORLD,
    steps_per_second: int | None = None,
) -> Any:
    """The ``TaskConfig`` an agent trained under ``trained`` is evaluated under: its inputs, actions and hand; all else
    is the same for every agent.

    Raises:
        EvaluationError: a setting out of range, or a world that is unknown or not installed.
    """
    if world not in WORLDS:
        raise EvaluationError(f"world = {world!r}; allowed are {', '.join(map(repr, WORLDS))}")
    engine = engine_of(world)
    changes: dict[str, Any] = {
        "objects": objects,
        "scaling": scaling,
        "variants": sizes,
        "variant_seed": derive(seed, "evaluation", "sizes"),
        "extent_range": EXTENT_RANGE,
        "randomization": randomization,
        "gravity": STANDARD_GRAVITY,
        "goals": goals,
        "horizon": HORIZON,
        "success_angle": SUCCESS_ANGLE,
        "grasps": GRASPS,
        "grasp_spread": 0.0,
    }
    try:
        engine.require()
    except EngineError as error:
        raise EvaluationError(f"world = {world!r}: {error}") from None
    try:
        changes["simulation"] = trained.simulation.plain(steps_per_second or engine.evaluation_rate, world)
        return trained.changed(changes)
    except ValueError as error:
        raise EvaluationError(f"the evaluation's task: {' '.join(str(error).split())}") from None


def _extents(prefix: str, thing: Any) -> dict[str, Any]:
    return {f"{prefix}_{axis}": float(extent) for axis, extent in zip("xyz", thing.extents, strict=True)}


def _bodies(variants: Any) -> list[Body]:
    """The environment's variants by object and size: nominal ones first, then random sizes counted from 1."""
    bodies: list[Body] = []
    for index, thing in enumerate(variants.objects):
        size = sum(body.name == thing.name for body in bodies)
        bodies.append(Body(thing.name, size, bool(variants.playable[index])))
    return bodies
