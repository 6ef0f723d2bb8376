"""Planned episodes as demonstrations: what was executed, and the best and some other roll-outs of every plan.

One file an episode, so that any number of processes can work on one directory and a killed one loses nothing.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import randomization
from object_sets import Object
from tactile_kit.planning.planner import Planner, PlannerConfig, Rollout, State
from tactile_kit.simulation.simulator import Status
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.core import Core
from tactile_kit.task.goals import EpisodeSpec, training_episodes
from tactile_kit.task.rotations import geodesic

KEPT = 6  # roll-outs kept of each plan: half of them its best, half of them any


class DemonstrationError(ValueError):
    """A file or directory of demonstrations is not what it should be."""


@dataclass(frozen=True)
class Demonstration:
    """One episode and the roll-outs planned on its way, one after the other: pieces of ``length (P,)`` actions.

    A piece of N actions has N + 1 states. ``z (S, 144)``, ``x (S, 3)``, ``R (S, 3, 3)``, ``q (S, 12)`` over all states,
    ``actions (A, 12)`` over all actions; ``failed (P,)`` whether a piece ended in a drop; the first piece was executed.
    """

    z: NDArray[np.float32]
    x: NDArray[np.float64]
    R: NDArray[np.float64]
    q: NDArray[np.float32]
    actions: NDArray[np.float32]
    length: NDArray[np.int64]
    failed: NDArray[np.bool_]
    goal: NDArray[np.float64]
    origin: NDArray[np.float64]
    object: NDArray[np.str_]  # its name, ()
    extents: NDArray[np.float64]  # (3,) m
    theta: NDArray[np.float64]  # angle to the goal after every executed action


def play(core: Core, planner: Planner, spec: EpisodeSpec, gravity: float) -> Demonstration:
    """Plan one episode from its start to its end."""
    simulator = planner.simulator
    simulator.reset(spec.variant, spec.seed, gravity)
    planner.start(spec.seed)
    generator = randomization.stream(spec.seed, "demonstration")
    pieces: list[Rollout] = []
    states, actions, status = [State.of(simulator.world)], [], Status.RUNNING
    while status == Status.RUNNING:
        action = planner.act(spec.goal)
        status = simulator.step(action)
        actions.append(action)
        states.append(State.of(simulator.world))
        pieces += _kept(planner.rollouts, generator)
    executed = Rollout(states, np.array(actions), 0.0, status in (Status.DROP, Status.FAULT))
    thing = core.variants.objects[spec.variant]
    return _joined([executed, *pieces], spec, thing, simulator.initial_position)


def _kept(rollouts: Sequence[Rollout], generator: np.random.Generator) -> list[Rollout]:
    order = sorted(range(len(rollouts)), key=lambda index: -rollouts[index].score)
    best, others = order[: KEPT // 2], order[KEPT // 2 :]
    chosen = generator.permutation(others)[: KEPT - len(best)].astype(int).tolist()
    return [rollouts[index] for index in [*best, *chosen] if len(rollouts[index].actions)]


def _joined(pieces: Sequence[Rollout], spec: EpisodeSpec, thing: Object, origin: NDArray) -> Demonstration:
    states = [state for piece in pieces for state in piece.states]
    return Demonstration(
        z=np.stack([state.z for state in states]),
        x=np.stack([state.x for state in states]),
        R=np.stack([state.R for state in states]),
        q=np.stack([state.q for state in states]).astype(np.float32),
        actions=np.concatenate([piece.actions for piece in pieces]).astype(np.float32),
        length=np.array([len(piece.actions) for piece in pieces]),
        failed=np.array([piece.failed for piece in pieces]),
        goal=spec.goal,
        origin=origin,
        object=np.array(thing.name),
        extents=np.asarray(thing.extents),
        theta=geodesic(np.stack([state.R for state in pieces[0].states[1:]]), spec.goal),
    )


def collect(
    task: TaskConfig,
    directory: Path | str,
    numbers: Iterable[int],
    seed: int = 0,
    planner: PlannerConfig | None = None,
) -> None:
    """Plan the episodes ``numbers`` of ``task`` and write ``directory/episode-NNNNN.npz``; those there are kept."""
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    core = Core(task)
    guide = Planner(core.blueprint.build(), planner, task.reward)
    for number in numbers:
        path = directory / f"episode-{number:05d}.npz"
        if path.exists():
            continue
        spec = next(
            training_episodes(task, core.variants, 0, randomization.derive(seed, "demonstrations", number))
        )
        demonstration = play(core, guide, spec, task.gravity)
        handle, temporary = tempfile.mkstemp(dir=directory, suffix=".partial")
        with os.fdopen(handle, "wb") as file:
            np.savez_compressed(file, allow_pickle=False, **vars(demonstration))
        os.replace(temporary, path)
    guide.close()


def load(path: Path | str) -> Demonstration:
    """Read one file.

    Raises:
        DemonstrationError: an entry is missing or does not fit the others; the message names file and entry.
    """
    names = [field.name for field in fields(Demonstration)]
    with np.load(path, allow_pickle=False) as data:
        missing = [name for name in names if name not in data]
        if missing:
            raise DemonstrationError(f"{path}: entries {missing} are missing")
        demonstration = Demonstration(**{name: data[name] for name in names})
    states, actions = int((demonstration.length + 1).sum()), int(demonstration.length.sum())
    for name, shape in {
        "z": (states, 144), "x": (states, 3), "R": (states, 3, 3), "q": (states, 12), "actions": (actions, 12),
        "failed": demonstration.length.shape, "goal": (3, 3), "origin": (3,), "object": (), "extents": (3,),
    }.items():  # fmt: skip
        if getattr(demonstration, name).shape != shape:
            raise DemonstrationError(
                f"{path}: {name} is {getattr(demonstration, name).shape}, expected {shape}"
            )
    return demonstration
