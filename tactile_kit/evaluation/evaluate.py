"""Roll-outs of a trained agent, one row an episode (paper, Sec. III-C)."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal

from tactile_kit.evaluation.cases import GOALS, Case, Episode, Given, Scaling, goal_rotation, make_cases, make_episodes
from tactile_kit.evaluation.errors import EvaluationError
from tactile_kit.evaluation.rows import SUCCESS_ANGLE, EpisodeRow

if TYPE_CHECKING:
    from object_sets import Object


def evaluate(
    agent: Any,
    objects: str | Sequence[Object] = "paper",
    *,
    goals: Literal["octahedral", "so3"] = "octahedral",
    episodes_per_goal: int = 1,
    seed: int = 0,
    given: Given | str | Object = "true",
    scaling: Scaling = "nominal",
    sizes: int = 1,
    goals_per_case: int = GOALS,
    num_envs: int = 16,
    num_workers: int = 1,
    name: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[EpisodeRow]:
    """Evaluates an agent and returns one row an episode, in the order of ``cases.make_episodes``.

    Args:
        agent: what ``tactile_kit.load_agent`` returns, or an agent's directory.
        objects: names as ``object_sets.select`` takes them, or objects.
        goals: the 24 octahedral goals, or goals uniform on SO(3).
        episodes_per_goal: repeats of each goal, each with its own initial grasp and randomisation.
        seed: of the evaluation. Its streams are apart from training's of the same number.
        given: the mesh the agent is told of: ``true``, ``nominal`` (median extents), ``each`` (every object in turn), or
            one object (by name) for all.
        scaling, sizes, goals_per_case: see ``cases.make_cases``.
        num_envs, num_workers: how the work is spread; the rows don't depend on it.
        name: what the rows call the agent; its directory's name by default.
        progress: called with (episodes done, episodes in all) now and then.

    Raises:
        EvaluationError: an argument out of range; unknown objects raise ``object_sets``' error with the nearest name.
    """
    import object_sets

    chosen = list(object_sets.select(objects)) if isinstance(objects, str) else list(objects)
    if isinstance(given, str) and given not in ("true", "nominal", "each"):
        given = _single(given)
    cases = make_cases(
        chosen, scaling=scaling, sizes=sizes, given=given, goals=goals, goals_per_case=goals_per_case, seed=seed
    )
    episodes = make_episodes(cases, episodes_per_goal, seed)
    return run_cases(
        agent, cases, episodes, num_envs=num_envs, num_workers=num_workers, seed=seed, name=name, progress=progress
    )


def _single(name: str) -> Object:
    import object_sets

    found = list(object_sets.select(name))
    if len(found) != 1:
        raise EvaluationError(f"given = {name!r} names {len(found)} objects; allowed are 'true', 'nominal', 'each' or one")
    return found[0]
