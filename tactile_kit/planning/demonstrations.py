"""Planned episodes as demonstrations: what was executed, and how every chosen plan went when it was shaken.

One file an episode, so that any number of processes can work on one directory and a killed one loses nothing. With an
agent that acts in between, the planner shows what to do where the agent gets to (Ross et al. 2011).
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import randomization
from object_sets import Object
from tactile_kit.agents.files import write_atomically
from tactile_kit.hand.kinematics import JOINTS
from tactile_kit.planning.planner import Planner, PlannerConfig, Rollout, State
from tactile_kit.simulation.simulator import Status
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.core import Core
from tactile_kit.task.goals import EpisodeSpec, training_episodes
from tactile_kit.task.observation import Belief
from tactile_kit.task.rotations import geodesic

KEPT = 12  # actions of a shaken roll-out; the planner thinks again after the first move
TURNS = (3, 25)  # control steps that an agent acts for, least and beyond most
Act = Callable[[NDArray[np.float32]], NDArray]  # observations (1, D) to actions (1, 12)


class DemonstrationError(ValueError):
    """A file or directory of demonstrations is not what it should be."""


@dataclass(frozen=True)
class Demonstration:
    """What the planner did in one episode, and in roll-outs on its way: pieces of ``length (P,)`` actions.

    A piece of N actions has N + 1 states. ``z (S, 144)``, ``x (S, 3)``, ``R (S, 3, 3)``, ``q (S, 12)`` over all states,
    ``actions (A, 12)`` over all actions; ``failed (P,)`` whether a piece ended in a drop.
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
    theta: NDArray[np.float64]  # angle to the goal after every action of the episode, (T,)


def play(
    core: Core,
    planner: Planner,
    spec: EpisodeSpec,
    gravity: float,
    agent: Act | None = None,
    share: float = 0.5,
) -> Demonstration:
    """Plan one episode from its start to its end; between two moves an ``agent`` takes over
    for a while in ``share`` of the cases."""
    simulator = planner.simulator
    simulator.reset(spec.variant, spec.seed, gravity)
    planner.start(spec.seed)
    generator = randomization.stream(spec.seed, "demonstration")
    pieces: list[Rollout] = []
    states, actions, theta = [State.of(simulator.world)], list[NDArray](), list[float]()
    status, left = Status.RUNNING, 0
    while status == Status.RUNNING:
        rested = bool(actions) or not theta  # after an agent's turn the planner gets a move at least
        if left == 0 and rested and agent and planner.gait.over and generator.random() < share:
            left = int(generator.integers(*TURNS))
            pieces += _piece(states, actions, False)
            planner.forget()
        if left > 0:
            assert agent is not None
            left -= 1
            state = State.of(simulator.world)
            status = simulator.step(agent(_observation(core, state, spec))[0])
            states, actions = [State.of(simulator.world)], []
        else:
            action = planner.act(spec.goal)
            status = simulator.step(action)
            actions.append(action)
            states.append(State.of(simulator.world))
            for rollout in planner.rollouts:
                ends = rollout.failed and len(rollout.actions) <= KEPT
                pieces += _piece(rollout.states[: KEPT + 1], rollout.actions[:KEPT].tolist(), ends)
        theta.append(float(geodesic(simulator.world.rotation, spec.goal)))
    pieces += _piece(states, actions, status in (Status.DROP, Status.FAULT))
    return _joined(pieces, spec, core.variants.objects[spec.variant], simulator.initial_position, theta)


def _piece(states: list[State], actions: list, failed: bool) -> list[Rollout]:
    """A piece, or none where nothing was done."""
    return [Rollout(states, np.array(actions), 0.0, failed)] if actions else []


def _observation(core: Core, state: State, spec: EpisodeSpec) -> NDArray[np.float32]:
    belief = Belief(state.x[None].astype(np.float32), state.R[None].astype(np.float32))
    return core.observer(state.z[None], spec.goal[None], belief, np.array([spec.given]))


def _joined(
    pieces: Sequence[Rollout], spec: EpisodeSpec, thing: Object, origin: NDArray, theta: list[float]
) -> Demonstration:
    states = [state for piece in pieces for state in piece.states]
    return Demonstration(
        z=np.array([state.z for state in states], np.float32).reshape(-1, 144),
        x=np.array([state.x for state in states]).reshape(-1, 3),
        R=np.array([state.R for state in states]).reshape(-1, 3, 3),
        q=np.array([state.q for state in states], np.float32).reshape(-1, JOINTS),
        actions=np.array([row for piece in pieces for row in piece.actions], np.float32).reshape(-1, JOINTS),
        length=np.array([len(piece.actions) for piece in pieces], np.int64),
        failed=np.array([piece.failed for piece in pieces], bool),
        goal=spec.goal,
        origin=origin,
        object=np.array(thing.name),
        extents=np.asarray(thing.extents),
        theta=np.array(theta),
    )


def collect(
    task: TaskConfig,
    directory: Path | str,
    numbers: Iterable[int],
    seed: int = 0,
    planner: PlannerConfig | None = None,
    agent: Act | None = None,
    share: float = 0.5,
) -> None:
    """Plan the episodes ``numbers`` of ``task`` and write ``directory/episode-NNNNN.npz``; those there are kept.

    Args:
        task: objects, encoding and everything else; without randomisation the planner foresees what happens.
        directory: made where it is missing.
        numbers: of the episodes; each follows from its number and ``seed`` alone.
        planner: settings of the planner.
        agent: takes over for a while between two moves, in ``share`` of the cases, so that the planner is asked where
            the agent gets to.
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    core = Core(task)
    guide = Planner(core.blueprint.build(), planner)
    for number in numbers:
        path = directory / f"episode-{number:05d}.npz"
        if path.exists():
            continue
        spec = next(
            training_episodes(task, core.variants, 0, randomization.derive(seed, "demonstrations", number))
        )
        demonstration = play(core, guide, spec, task.gravity, agent, share)
        if not len(demonstration.length):
            continue  # the agent did it all
        content = io.BytesIO()
        np.savez_compressed(content, allow_pickle=False, **vars(demonstration))
        write_atomically(path, content.getvalue())
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
