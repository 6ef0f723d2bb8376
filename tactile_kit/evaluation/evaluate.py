"""Roll-outs of a trained agent, one row an episode (paper, Sec. III-C)."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

from randomization import derive
from tactile_kit.errors import EvaluationError
from tactile_kit.evaluation.cases import GOALS
from tactile_kit.evaluation.estimators import told
from tactile_kit.evaluation.rows import EpisodeRow
from tactile_kit.evaluation.schedule import HORIZON, WORLD, Schedule, schedule

NUM_ENVS = 16


def evaluate(
    agent: Any,
    objects: str | Path | Sequence[str | Path] = "paper",
    *,
    goals: Literal["octahedral", "so3"] = "octahedral",
    episodes_per_goal: int = 1,
    seed: int = 0,
    given: str = "true",
    scaling: Literal["nominal", "random"] = "nominal",
    sizes: int = 1,
    goals_per_case: int = GOALS,
    randomization: str = "default",
    world: str = WORLD,
    steps_per_second: int | None = None,
    estimator: str = "own",
    num_envs: int = NUM_ENVS,
    num_workers: int = 1,
    name: str | None = None,
    progress: Callable[[int, int], None] | None = None,
    quiet: bool = False,
) -> list[EpisodeRow]:
    """Evaluates an agent and returns one row an episode, in the order of ``cases.make_episodes``.

    All agents are evaluated alike, whatever they were trained under: full gravity, 10 s, the same randomisation.
    Actions are the policy's mean. A tactile agent sees its own estimate, never the truth.

    Args:
        agent: what ``tactile_kit.load_agent`` returns, or an agent's directory.
        objects: sets, names or ids, separated by commas, paths of sets or of one object in them (``my_set/mug``), or a
            list of these, as ``object_sets.select`` takes them. An object of which no grasp is found has no rows; that
            is logged as a warning.
        goals: the 24 octahedral goals, or goals uniform on SO(3).
        episodes_per_goal: repeats of each goal, each with its own initial grasp and randomisation.
        seed: of the evaluation. Its streams are apart from training's of the same number.
        given: the mesh the agent is told of: ``true``, ``nominal`` (median extents), ``each`` (the nominal mesh of
            every object in turn), or an object's name.
        scaling: nominal sizes, or extents drawn an axis from U[4.5, 9] cm.
        sizes: how many random sizes an object; 1 where scaling is nominal.
        goals_per_case: how many of the 24 goals each body and mesh is given.
        randomization: preset of domain randomisation.
        world: the physics: ``bullet``, or ``mujoco`` (extra ``transfer``), with the same protocol: grasps found by the
            same heuristic, randomisation, goals and seeds.
        steps_per_second: of the physics, a multiple of 60, whatever the agent was trained with; the world's own by
            default.
        estimator: what tells the agent of the pose: ``own``, as it was trained; ``kalman`` or ``rest``, which learn
            nothing (``tactile_kit.estimator``); or a tactile agent's directory, whose cell it then is.
        num_envs, num_workers: how the work, a search for grasps too, is spread over environments and processes.
        name: what the rows call the agent; its directory's name by default.
        progress: called with (episodes done, episodes in all) now and then.
        quiet: show nothing of a search for grasps on stderr.

    Raises:
        EvaluationError: an argument out of range; unknown objects raise ``object_sets``' error with the nearest name.
    """
    if num_envs < 1 or num_workers < 0:
        raise EvaluationError(
            f"num_envs = {num_envs}, num_workers = {num_workers}; allowed are >= 1 and >= 0"
        )
    from tactile_kit.agents.agent import load_agent

    if isinstance(agent, (str, os.PathLike)):
        agent = load_agent(Path(agent))
    agent = told(agent, estimator)
    plan = schedule(
        agent.task, objects, goals=goals, episodes_per_goal=episodes_per_goal, seed=seed, given=given, scaling=scaling,
        sizes=sizes, goals_per_case=goals_per_case, randomization=randomization, world=world,
        steps_per_second=steps_per_second, num_workers=num_workers, quiet=quiet,
    )  # fmt: skip
    envs = min(num_envs, len(plan.specs))
    results = _roll_out(agent, plan, envs, num_workers, seed, progress)
    manifest, label = agent.manifest, name or agent.directory.name
    return [
        plan.row(
            number,
            result,
            agent=label,
            kind=agent.kind,
            encoding=manifest.encoding,
            training_seed=manifest.seed,
        )
        for number, result in enumerate(results)
    ]


def _roll_out(
    agent: Any, plan: Schedule, num_envs: int, num_workers: int, seed: int, progress: Callable | None
) -> list:
    """Plays the episodes, each once; their results in order."""
    specs = plan.specs
    env = agent.make_env(
        config=plan.task,
        num_envs=num_envs,
        num_workers=num_workers,
        seed=derive(seed, "evaluation"),
        episodes=specs,
        variants=plan.variants,
    )
    try:
        observations = env.reset()
        if progress is not None:
            progress(0, len(specs))
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
