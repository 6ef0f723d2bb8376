"""Roll-outs of a trained agent, one row an episode (paper, Sec. III-C)."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from randomization import STANDARD_GRAVITY, derive
from tactile_kit.evaluation.cases import GOALS, Body, goal_rotation, make_cases, make_episodes
from tactile_kit.evaluation.errors import EvaluationError
from tactile_kit.evaluation.rows import SUCCESS_ANGLE, EpisodeRow

HORIZON = 100  # actions of 0.1 s: T = 10 s
# Physics steps a second: the finest that a whole `make reproduce` affords; docs/physics.md has finer ones beside it.
STEPS_PER_SECOND = 120
GRASPS = 8  # initial grasps a body; episodes draw among them
NUM_ENVS = 16
EXTENT_RANGE = (0.045, 0.09)  # m; paper, Fig. 4


def evaluate(
    agent: Any,
    objects: str = "paper",
    *,
    goals: Literal["octahedral", "so3"] = "octahedral",
    episodes_per_goal: int = 1,
    seed: int = 0,
    given: str = "true",
    scaling: Literal["nominal", "random"] = "nominal",
    sizes: int = 1,
    goals_per_case: int = GOALS,
    randomization: str = "default",
    steps_per_second: int = STEPS_PER_SECOND,
    num_envs: int = NUM_ENVS,
    num_workers: int = 1,
    name: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[EpisodeRow]:
    """Evaluates an agent and returns one row an episode, in the order of ``cases.make_episodes``.

    All agents are evaluated alike, whatever they were trained under: full gravity, 10 s, the same randomisation.
    Actions are the policy's mean. A tactile agent sees its own estimate, never the truth.

    Args:
        agent: what ``tactile_kit.load_agent`` returns, or an agent's directory.
        objects: sets, names or ids, separated by commas, as ``object_sets.select`` takes them.
        goals: the 24 octahedral goals, or goals uniform on SO(3).
        episodes_per_goal: repeats of each goal, each with its own initial grasp and randomisation.
        seed: of the evaluation. Its streams are apart from training's of the same number.
        given: the mesh the agent is told of: ``true``, ``nominal`` (median extents), ``each`` (the nominal mesh of
            every object in turn), or an object's name.
        scaling: nominal sizes, or extents drawn an axis from U[4.5, 9] cm.
        sizes: how many random sizes an object; 1 where scaling is nominal.
        goals_per_case: how many of the 24 goals each body and mesh is given.
        randomization: preset of domain randomisation.
        steps_per_second: of the physics, a multiple of 60, whatever the agent was trained with.
        num_envs, num_workers: how the work is spread over environments and processes.
        name: what the rows call the agent; its directory's name by default.
        progress: called with (episodes done, episodes in all) now and then.

    Raises:
        EvaluationError: an argument out of range; unknown objects raise ``object_sets``' error with the nearest name.
    """
    if sizes < 1 or (scaling == "nominal" and sizes != 1):
        raise EvaluationError(
            f"sizes = {sizes}; allowed are integers >= 1, and 1 only where scaling is nominal"
        )
    if goals not in ("octahedral", "so3"):
        raise EvaluationError(f"goals = {goals!r}; allowed are 'octahedral' and 'so3'")
    if num_envs < 1 or num_workers < 0:
        raise EvaluationError(
            f"num_envs = {num_envs}, num_workers = {num_workers}; allowed are >= 1 and >= 0"
        )
    import object_sets
    from tactile_kit.agents.agent import load_agent
    from tactile_kit.task.goals import EpisodeSpec
    from tactile_kit.task.variants import prepare

    if isinstance(agent, (str, os.PathLike)):
        agent = load_agent(Path(agent))
    names = [thing.name for thing in object_sets.select(objects)]
    lent = "" if given in ("true", "nominal", "each") else given
    task = evaluation_task(
        agent.task,
        f"{objects},{lent}" if lent else objects,
        seed,
        scaling,
        sizes,
        goals=goals,
        randomization=randomization,
        steps_per_second=steps_per_second,
    )
    variants = prepare(task)
    bodies = _bodies(variants)
    if lent:
        (lent,) = (thing.name for thing in object_sets.select(lent))
    cases = make_cases(
        bodies, set(names), given=lent or given, goals=goals, goals_per_case=goals_per_case, seed=seed
    )
    episodes = make_episodes(bodies, cases, episodes_per_goal, seed)
    specs = [EpisodeSpec(cases[e.case].held, cases[e.case].given, goal_rotation(e), e.seed) for e in episodes]
    results = _roll_out(agent, task, specs, min(num_envs, len(specs)), num_workers, seed, progress)
    label = name or agent.directory.name
    rows = []
    for episode, result in zip(episodes, results, strict=True):
        case = cases[episode.case]
        held, told = variants.objects[case.held], variants.objects[case.given]
        fault = (result.fault or "").replace("\n", " ")
        rows.append(
            EpisodeRow(
                agent=label,
                kind=agent.kind,
                encoding=agent.manifest.encoding,
                training_seed=agent.manifest.seed,
                object_id=held.id,
                object=held.name,
                size=bodies[case.held].size,
                **_extents("extent", held),
                given_id=told.id,
                given=told.name,
                **_extents("given_extent", told),
                goal=episode.goal,
                episode=episode.repeat,
                seed=episode.seed,
                theta=None if fault else result.theta,
                theta_min=None if fault else result.theta_min,
                success=result.success and not fault,
                drop=result.drop,
                fault=fault,
                steps=result.steps,
            )
        )
    return rows


def evaluation_task(
    trained: Any,
    objects: str,
    seed: int,
    scaling: str = "nominal",
    sizes: int = 1,
    *,
    goals: str = "octahedral",
    randomization: str = "default",
    steps_per_second: int = STEPS_PER_SECOND,
) -> Any:
    """The ``TaskConfig`` an agent trained under ``trained`` is evaluated under: its inputs, actions and hand; all else
    is the same for every agent."""
    changes = {
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
        "goal_every": 0,
        "simulation": {**trained.simulation.model_dump(), "steps_per_second": steps_per_second},
    }
    try:
        return type(trained)(**{**trained.model_dump(), **changes})
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


def _roll_out(
    agent: Any, task: Any, specs: list, num_envs: int, num_workers: int, seed: int, progress: Callable | None
) -> list:
    """Plays the episodes, each once; their results in order."""
    env = agent.make_env(
        config=task,
        num_envs=num_envs,
        num_workers=num_workers,
        seed=derive(seed, "evaluation"),
        episodes=specs,
    )
    try:
        observations = env.reset()
        # Environments that have run out of episodes play on; so this bounds the steps any evaluation can take.
        for _ in range((HORIZON + 1) * len(specs)):
            env.step_async(agent.act(observations))
            observations, _, dones, _ = env.step_wait()
            if dones.any():
                done = sum(result is not None for result in env.results)
                if progress is not None:
                    progress(done, len(specs))
                if done == len(specs):
                    return list(env.results)
        raise EvaluationError(f"{len(specs)} episodes did not end within {HORIZON} steps each")
    finally:
        env.close()
