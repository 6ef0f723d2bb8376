"""Plays training episodes with fixed actions; ``python episodes.py WORKERS ENGINE`` prints a digest of all shown."""

from __future__ import annotations

import hashlib
import sys
from typing import Any

import numpy as np

from tactile_kit.task.config import TaskConfig
from tactile_kit.task.vec_env import ReorientVecEnv

TASK = TaskConfig(objects="cube,l_shape", grasps=2, horizon=10)
ENVIRONMENTS, STEPS = 4, 24  # past two ends of each environment's episodes


class Play:
    """One environment, stepped with actions of its own, and the digest of everything it showed."""

    def __init__(self, seed: int = 7, workers: int = 0, engine: str = "bullet", **settings: Any) -> None:
        task = TASK.changed({"simulation": {"engine": engine}})
        self.env = ReorientVecEnv(task, num_envs=ENVIRONMENTS, num_workers=workers, seed=seed, **settings)
        self.actions = np.random.default_rng(seed)
        self.shown, self.ended, self.first = hashlib.sha256(), 0, self.env.reset()
        self.shown.update(self.first.tobytes())

    def step(self, nonsense: bool = False) -> None:
        """One step; ``nonsense``: one environment's action is no number, and its episode ends in a fault."""
        action = self.actions.uniform(-0.6, 0.2, (ENVIRONMENTS, 12)).astype(np.float32)
        action[:, 1::3] -= 0.3
        if nonsense:
            action[0] = np.nan
        observation, reward, done, infos = self.env.step(action)
        for array in (observation, reward, done):
            self.shown.update(np.ascontiguousarray(array).tobytes())
        for info in infos:
            self.shown.update(repr(sorted(info.get("randomization", {}).items())).encode())
        self.ended += int(done.sum())

    def digest(self, steps: int = STEPS) -> str:
        """What ``steps`` steps show, after which the environment is closed."""
        for _ in range(steps):
            self.step()
        self.env.close()
        return self.shown.hexdigest()


if __name__ == "__main__":
    print(Play(workers=int(sys.argv[1]), engine=sys.argv[2]).digest())
