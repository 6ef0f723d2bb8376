"""How well an estimator follows: error of the angle against time, and whether its sigma says how large it is.

For development: episodes are played in the compiled physics. What is reported of an agent is measured in Bullet.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from randomization import derive
from tactile_kit.errors import EvaluationError
from tactile_kit.evaluation.compiled import compiled_task, played
from tactile_kit.evaluation.schedule import HORIZON
from tactile_kit.rotations import geodesic

Array = NDArray[np.float64]
SECONDS = (1, 2, 5, 10)  # at which errors are told
CLOSE = 0.4  # rad, the task's own measure of success
LOST = 1.0  # rad, beyond which a face may well be taken for another


@dataclass(frozen=True)
class Followed:
    """N episodes of 10 s, first axis control steps.

    angle: ``(100, N)`` rad, error of the estimated orientation after each step; position: ``(100, N)`` m;
    sigma: ``(100, N)`` rad, predicted; goal, believed: ``(100, N)`` rad, true and believed angle to the goal;
    held: ``(100, N) bool``, steps that were played; object_id: ``(N,)``.
    """

    angle: Array
    position: Array
    sigma: Array
    goal: Array
    believed: Array
    held: NDArray[np.bool_]
    object_id: NDArray[np.int64]

    def of(self, ids: Sequence[int]) -> Followed:
        """The episodes of some objects."""
        which = np.isin(self.object_id, ids)
        names = ("angle", "position", "sigma", "goal", "believed", "held")
        parts: dict[str, Any] = {name: getattr(self, name)[:, which] for name in names}
        return Followed(**parts, object_id=self.object_id[which])

    def figures(self) -> dict[str, float]:
        """Errors of the angle (rad), how the episodes ended, and calibration, by name.

        ``mean`` over all steps; ``mean_1s``, ``median_1s`` and so on at 1, 2, 5 and 10 s; ``within_10s``, the share
        within 0.4 rad then, and ``lost_10s``, beyond 1 rad. ``success`` and ``drops`` are shares of all episodes;
        ``theta`` and ``believed`` the mean true and believed angle to the goal at 10 s of those held, ``reached`` the
        share that believes itself within 0.4 rad of it. ``calibration``: root mean square of error over sigma, 1 where
        sigma says what the error is. ``position``: mean error in m.

        Raises:
            EvaluationError: no step was played.
        """
        if not self.held.any():
            raise EvaluationError("no step was played: nothing to say of the estimates")
        found = {"episodes": float(self.held.shape[1]), "mean": float(self.angle[self.held].mean())}
        for second in SECONDS:
            row = 10 * second - 1
            errors = self.angle[row, self.held[row]]
            if len(errors):
                found |= {
                    f"mean_{second}s": float(errors.mean()),
                    f"median_{second}s": float(np.median(errors)),
                }
        last = self.held[-1]
        if last.any():
            found |= {
                "within_10s": float((self.angle[-1, last] < CLOSE).mean()),
                "lost_10s": float((self.angle[-1, last] > LOST).mean()),
                "reached": float((self.believed[-1, last] < CLOSE).mean()),
                "theta": float(self.goal[-1, last].mean()),
                "believed": float(self.believed[-1, last].mean()),
            }
        found["success"] = float((last & (self.goal[-1] < CLOSE)).mean())
        found["drops"] = float((~last).mean())
        ratio = self.angle[self.held] / self.sigma[self.held]
        found["calibration"] = float(np.sqrt(np.mean(ratio**2)))
        found["position"] = float(self.position[self.held].mean())
        return found


def follow(
    agent: Any,
    objects: str = "geometric8",
    *,
    truth: bool,
    episodes: int = 512,
    seed: int = 0,
    threads: int = 1,
) -> Followed:
    """Play ``episodes`` of a tactile agent at full gravity and default randomisation, objects of nominal size in turn.

    Args:
        agent: what ``tactile_kit.load_agent`` returns; its policy acts without noise.
        truth: whether the policy is told the true pose while the estimator follows, or the estimate.
        episodes: all at once, one an environment. seed: of the episodes; apart from training's.

    Raises:
        EvaluationError: the agent has no estimator.
    """
    if agent.estimator is None:
        raise EvaluationError(f"{agent.directory}: an {agent.kind} has no estimator")
    names = ("angle", "position", "sigma", "goal", "believed")
    rows: dict[str, Any] = {name: np.full((HORIZON, episodes), np.nan) for name in names}
    held = np.zeros((HORIZON, episodes), bool)
    seed = derive(seed, "evaluation", "estimates")
    with closing(agent.make_env(compiled_task(agent, objects), episodes, threads, seed)) as env:
        env.coupling.told = truth
        observation = env.reset()
        object_id = np.array([env.variants.objects[v].id for v in env.state.variant])
        for step, (playing, _, _) in enumerate(played(agent, env, observation)):
            last, estimate = env.transition, env.estimated
            row = {
                "angle": geodesic(estimate.R, last.R),
                "position": np.linalg.norm(estimate.x - last.x, axis=1),
                "sigma": estimate.sigma[:, 1],
                "goal": geodesic(last.R, last.goal),
                "believed": geodesic(estimate.R, last.goal),
            }
            for name, values in row.items():
                rows[name][step] = np.where(playing, values, np.nan)
            held[step] = playing
    return Followed(**rows, held=held, object_id=object_id)
