"""Demonstrations as replay memory for a learner: the same transitions, seen through the learner's own observation."""

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
    paths = sorted(Path(directory).glob("*.npz"))
    if not paths:
        raise DemonstrationError(f"{directory}: no demonstrations (*.npz)")
    parts = [_transitions(env, path, load(path)) for path in paths]
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    arrays["episodes"] = np.concatenate([[0], np.cumsum(arrays["done"])[:-1]])
    replay = GoalReplay(len(arrays["done"]), env.observation_space, env.action_space, n_envs=1, **settings)
    replay.fill(arrays)
    return replay


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
