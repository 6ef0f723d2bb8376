"""Demonstrations as a learner would have seen them: as replay memory (SAC), as examples to imitate (PPO)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_kit.agents.replay import GoalReplay
from tactile_kit.planning.demonstrations import Demonstration, DemonstrationError, load
from tactile_kit.task.observation import Belief
from tactile_kit.task.reward import reward_terms


def replay_of(env: Any, directory: Path | str, **settings: Any) -> GoalReplay:
    """All demonstrations in ``directory`` as ``env`` (a ``ReorientVecEnv``) would have shown them.

    Args:
        env: whose observation, reward and objects are used.
        directory: holds the files that ``demonstrations.collect`` wrote.
        settings: further arguments of :class:`GoalReplay`.

    Raises:
        DemonstrationError: there are none, or one is of an object or size that ``env`` doesn't have.
    """
    paths = _files(directory)
    parts = [_transitions(env, path, load(path)) for path in paths]
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    arrays["episodes"] = np.concatenate([[0], np.cumsum(arrays["done"])[:-1]])
    replay = GoalReplay(len(arrays["done"]), env.observation_space, env.action_space, n_envs=1, **settings)
    replay.fill(arrays)
    return replay


def examples_of(env: Any, directory: Path | str) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Observations ``(N, D)`` and the planner's actions ``(N, 12)``, of pieces that did not fail.

    Args and errors as for :func:`replay_of`.
    """
    observations, actions = [], []
    for path in _files(directory):
        shown = load(path)
        variant = _variant(env, path, shown)
        good = np.repeat(~shown.failed, shown.length)
        last = np.cumsum(shown.length + 1) - 1
        states = np.setdiff1d(np.arange(len(shown.z)), last)[good]
        goal = np.broadcast_to(shown.goal, (len(states), 3, 3))
        belief = Belief(shown.x[states].astype(np.float32), shown.R[states].astype(np.float32))
        observations.append(env.core.observer(shown.z[states], goal, belief, np.full(len(states), variant)))
        actions.append(shown.actions[good])
    return np.concatenate(observations), np.concatenate(actions)


def _files(directory: Path | str) -> list[Path]:
    paths = sorted(Path(directory).glob("*.npz"))
    if not paths:
        raise DemonstrationError(f"{directory}: no demonstrations (*.npz)")
    return paths


def _transitions(env: Any, path: Path, shown: Demonstration) -> dict[str, NDArray]:
    variant = _variant(env, path, shown)
    states = len(shown.z)
    last = np.cumsum(shown.length + 1) - 1  # the state that ends each piece
    before = np.setdiff1d(np.arange(states), last)
    after = before + 1
    done = np.isin(after, last)
    goal = np.broadcast_to(shown.goal, (states, 3, 3))
    belief = Belief(shown.x.astype(np.float32), shown.R.astype(np.float32))
    seen = env.core.observer(shown.z, goal, belief, np.full(states, variant))
    failed = np.zeros(len(before), bool)
    failed[np.flatnonzero(done)] = shown.failed
    origin = np.broadcast_to(shown.origin, (len(before), 3))
    terms = reward_terms(
        env.config.reward, shown.R[before], shown.R[after], goal[before], shown.x[before], shown.x[after], origin,
        shown.q[after], failed,
    )  # fmt: skip
    R = shown.R
    return {
        "observations": seen[before],
        "next_observations": seen[after],
        "actions": shown.actions,
        "rotations": np.stack([R[before], R[after], R[before], R[after]], axis=1),
        "goals": goal[before],
        "rotation_rewards": terms["rotation"],
        "other_rewards": np.sum([value for name, value in terms.items() if name != "rotation"], axis=0),
        "terminated": failed,
        "done": done,
    }


def _variant(env: Any, path: Path, shown: Demonstration) -> int:
    for index, thing in enumerate(env.variants.objects):
        if thing.name == str(shown.object) and np.allclose(thing.extents, shown.extents, atol=1e-6):
            return index
    names = sorted({thing.name for thing in env.variants.objects})
    raise DemonstrationError(
        f"{path}: {shown.object} with extents {np.round(shown.extents, 4)} m is not an object of this task ({names})"
    )
