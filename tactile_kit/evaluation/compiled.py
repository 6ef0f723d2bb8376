"""How well an agent does without noise, in seconds: in the compiled physics, for curves of a training.

For development and for curves. What is reported of an agent is measured in Bullet.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from randomization import STANDARD_GRAVITY, derive
from tactile_kit.evaluation.schedule import HORIZON

Flags = NDArray[np.bool_]


class Held(NamedTuple):
    """What became of an agent's episodes: shares of all; mean final angle (rad) of those held, None for none."""

    episodes: int
    success: float
    drops: float
    theta: float | None


def held_out(agent: Any, objects: str, episodes: int = 512, *, seed: int = 0, threads: int = 1) -> Held:
    """Play one episode in each of ``episodes`` environments: random goals, objects of nominal size in turn, full
    gravity, default randomisation, the policy without noise and, of a tactile agent, told its estimate.

    Args:
        agent: what ``tactile_kit.load_agent`` returns. seed: of the episodes; apart from training's.
    """
    seed = derive(seed, "evaluation", "held-out")
    ended: list[dict[str, Any]] = []
    with closing(agent.make_env(compiled_task(agent, objects), episodes, threads, seed)) as env:
        for _, over, infos in played(agent, env, env.reset()):
            ended += [infos[i] for i in np.flatnonzero(over).tolist()]
    angles = [info["theta"] for info in ended if not info["drop"] and info.get("fault") is None]
    lost = sum(bool(info["drop"] or info.get("fault") is not None) for info in ended)
    success = sum(bool(info["success"]) for info in ended)
    theta = float(np.mean(angles)) if angles else None
    return Held(episodes, success / episodes, lost / episodes, theta)


def played(agent: Any, env: Any, observation: Any) -> Iterator[tuple[Flags, Flags, list[dict[str, Any]]]]:
    """Play the episodes that begin with ``observation (E, D)`` to their ends.

    Yields after each step which were playing, which of them ended with it, ``(E,)`` each, and the step's infos.
    """
    playing = np.ones(env.num_envs, bool)
    while playing.any():
        observation, _, done, infos = env.step(agent.act(observation))
        yield playing, playing & done, infos
        playing = playing & ~done


def compiled_task(agent: Any, objects: str) -> Any:
    """The agent's task at full gravity and default randomisation in the compiled physics, at nominal sizes."""
    changes = {
        "objects": objects,
        "scaling": "nominal",
        "randomization": "default",
        "gravity": STANDARD_GRAVITY,
        "goals": "so3",
        "horizon": HORIZON,
        "grasp_spread": 0.0,
        "simulation": {"engine": "compiled"},
    }
    return agent.task.changed(changes)
