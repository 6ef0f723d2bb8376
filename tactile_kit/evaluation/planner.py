"""The planner over finger gaits on the very episodes that agents are evaluated on: a privileged reference.

It sees the true state and tries its plans in a simulator of its own, so it is no agent that a robot could run; its rows
say what the hand and the task allow, and its cost what that takes without any training.
"""

from __future__ import annotations

import time
from collections.abc import Container, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_kit.errors import EvaluationError
from tactile_kit.evaluation.cases import GOALS
from tactile_kit.evaluation.rows import EpisodeRow
from tactile_kit.evaluation.schedule import STEPS_PER_SECOND, schedule
from tactile_kit.planning import Planner, PlannerConfig
from tactile_kit.processes import Workers
from tactile_kit.rotations import geodesic
from tactile_kit.simulation.episode import Status
from tactile_kit.task.config import TaskConfig

if TYPE_CHECKING:
    from tactile_kit.simulation.vector import Blueprint
    from tactile_kit.task.goals import EpisodeSpec

NAME = KIND = "planner"
ENCODING = "truth"  # it is told no encoding of the shape: it has the body itself


@dataclass(frozen=True)
class Played:
    """How a planned episode ended (angles to the goal in rad), and what it cost: seconds of one core."""

    theta: float
    theta_min: float
    success: bool
    drop: bool
    fault: str | None
    steps: int
    cpu_seconds: float


def play(planner: Planner, spec: EpisodeSpec, gravity: float, success_angle: float) -> Played:
    """Plan one episode from its start to its end; ``gravity`` in m/s², ``success_angle`` in rad."""
    began = time.process_time()
    simulator = planner.simulator
    simulator.reset(spec.variant, spec.seed, gravity)
    planner.start(spec.seed)
    angles, status = [float(geodesic(simulator.world.rotation, spec.goal))], Status.RUNNING
    while status == Status.RUNNING:
        status = simulator.step(planner.act(spec.goal))
        angles.append(float(geodesic(simulator.world.rotation, spec.goal)))
    return Played(
        theta=angles[-1],
        theta_min=min(angles),
        success=status == Status.TIME and angles[-1] < success_angle,
        drop=status == Status.DROP,
        fault=simulator.fault,
        steps=simulator.elapsed,
        cpu_seconds=time.process_time() - began,
    )


def evaluate_planner(
    objects: str = "paper",
    *,
    planner: PlannerConfig | None = None,
    episodes_per_goal: int = 1,
    seed: int = 0,
    goals_per_case: int = GOALS,
    randomization: str = "default",
    steps_per_second: int = STEPS_PER_SECOND,
    num_workers: int = 0,
    done: Container[int] = (),
) -> Iterator[tuple[EpisodeRow, float]]:
    """Plays the episodes that ``evaluate`` plays under the same arguments; a row and its seconds of one core each.

    Rows come in the order of ``cases.make_episodes``, object by object, each as soon as it and those before it are
    there. They do not depend on ``num_workers``, nor on what is left out.

    Args:
        objects, episodes_per_goal, seed, goals_per_case, randomization, steps_per_second: as in ``evaluate``; the
            steps are those of the episode, the planner's own world may have coarser ones.
        planner: settings of the planner.
        num_workers: processes that plan, an episode each, and look for grasps before; 0 plans in this process.
        done: seeds of episodes to leave out.

    Raises:
        EvaluationError: an argument out of range; unknown objects raise ``object_sets``' error with the nearest name.
    """
    if num_workers < 0:
        raise EvaluationError(f"num_workers = {num_workers}; allowed are integers >= 0")
    from tactile_kit.task.core import Core

    plan = schedule(
        TaskConfig(encoding="none"), objects, episodes_per_goal=episodes_per_goal, seed=seed,
        goals_per_case=goals_per_case, randomization=randomization, steps_per_second=steps_per_second,
        num_workers=num_workers,
    )  # fmt: skip
    blueprint = Core(plan.task, variants=plan.variants).blueprint
    numbers = [number for number, episode in enumerate(plan.episodes) if episode.seed not in done]
    specs = [plan.specs[number] for number in numbers]
    work = (blueprint, planner or PlannerConfig(), plan.task.gravity, plan.task.success_angle)
    played = _here(*work, specs) if num_workers == 0 else _spread(*work, specs, num_workers)
    for number, outcome in zip(numbers, played, strict=True):
        row = plan.row(number, outcome, agent=NAME, kind=KIND, encoding=ENCODING, training_seed=0)
        yield row, outcome.cpu_seconds


def _planner(blueprint: Blueprint, config: PlannerConfig) -> Planner:
    """A planner with a simulator of its own, all compiled code loaded, so that no episode pays for that."""
    planner = Planner(blueprint.build(), config)
    planner.simulator.reset(0, 0, 0.0)
    planner.start(0)
    planner.act(np.eye(3))
    return planner


def _here(
    blueprint: Blueprint, config: PlannerConfig, gravity: float, angle: float, specs: list[EpisodeSpec]
) -> Iterator[Played]:
    if not specs:
        return
    planner = _planner(blueprint, config)
    try:
        for spec in specs:
            yield play(planner, spec, gravity, angle)
    finally:
        planner.close()
        planner.simulator.close()


def _spread(
    blueprint: Blueprint,
    config: PlannerConfig,
    gravity: float,
    angle: float,
    specs: list[EpisodeSpec],
    num_workers: int,
) -> Iterator[Played]:
    with Workers(num_workers, _begin, (blueprint, config, gravity, angle)) as workers:
        yield from workers.in_order(_play, specs)


_mine: tuple[Planner, float, float]  # a worker's planner, gravity and success angle


def _begin(blueprint: Blueprint, config: PlannerConfig, gravity: float, angle: float) -> None:
    global _mine
    _mine = _planner(blueprint, config), gravity, angle


def _play(spec: EpisodeSpec) -> Played:
    planner, gravity, angle = _mine
    return play(planner, spec, gravity, angle)
