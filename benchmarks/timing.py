"""Clocks and the motion that simulation benchmarks share."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import randomization
from tactile_kit.simulation.episode import FULL_RANGE, MIDDLE
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.vec_env import ReorientVecEnv

NOISE = 0.05  # of the joint range


def cpu_seconds(function: Callable[..., Any], *arguments: Any) -> float:
    """CPU time of this thread: waiting for other processes is left out."""
    start = time.thread_time()
    function(*arguments)
    return time.thread_time() - start


class Holding:
    """Environments of this process whose fingers hold their grasp under slightly noisy commands."""

    def __init__(self, task: TaskConfig, environments: int, seed: int = 0) -> None:
        self.env = ReorientVecEnv(task, num_envs=environments, num_workers=0, seed=seed)
        self.generator = randomization.stream(seed, "benchmark")
        self.steps = self.drops = 0
        self.env.reset()
        self.hold = np.empty((environments, len(MIDDLE)))
        self._regrasp(range(environments))
        self.run(5)

    def _regrasp(self, which: Any) -> None:
        for number in which:
            command = self.env.simulation.simulators[number].world.command
            self.hold[number] = (command - MIDDLE) / FULL_RANGE

    def run(self, steps: int) -> None:
        """So many control steps of every environment."""
        for _ in range(steps):
            noise = NOISE * self.generator.standard_normal(self.hold.shape)
            _, _, dones, infos = self.env.step(np.clip(self.hold + noise, -1, 1).astype(np.float32))
            self.steps += len(dones)
            if dones.any():
                ended = np.flatnonzero(dones)
                self.drops += sum(infos[i]["drop"] for i in ended)
                self._regrasp(ended)

    @property
    def drops_per_step(self) -> float:
        return self.drops / self.steps
