"""A small task of a cube and an L, prepared once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from tactile_kit.task.config import TaskConfig
from tactile_kit.task.variants import Variants, prepare
from tactile_kit.task.vec_env import ReorientVecEnv


@pytest.fixture(scope="session")
def task() -> TaskConfig:
    return TaskConfig(objects="cube,l_shape", horizon=5, grasps=2)


@pytest.fixture(scope="session")
def variants(task: TaskConfig, own_cache: None) -> Variants:
    return prepare(task)


@pytest.fixture
def build(task: TaskConfig, variants: Variants) -> Iterator[Callable[..., ReorientVecEnv]]:
    made = []

    def make(config: TaskConfig = task, **settings: Any) -> ReorientVecEnv:
        made.append(
            ReorientVecEnv(config, **{"num_envs": 2, "num_workers": 0, "variants": variants, **settings})
        )
        return made[-1]

    yield make
    for env in made:
        env.close()


@pytest.fixture
def play() -> Callable[..., list]:
    """Steps an environment with fixed actions; returns what each step gave."""

    def run(env: ReorientVecEnv, steps: int, seed: int = 0) -> list:
        rows: list[Any] = [env.reset()]
        rng = np.random.default_rng(seed)
        for _ in range(steps):
            env.step_async(rng.uniform(-0.6, 0.2, (env.num_envs, 12)).astype(np.float32))
            rows.append(env.step_wait())
        return rows

    return run
