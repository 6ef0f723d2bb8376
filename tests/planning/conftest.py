"""One cube, a short episode, a small planner."""

from __future__ import annotations

import pytest

from tactile_kit.planning import PlannerConfig
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.core import Core


@pytest.fixture(scope="session")
def task() -> TaskConfig:
    return TaskConfig(objects="cube", horizon=8, grasps=2)


@pytest.fixture(scope="session")
def core(task: TaskConfig, own_cache: None) -> Core:
    return Core(task)


@pytest.fixture(scope="session")
def small() -> PlannerConfig:
    return PlannerConfig(plans=8, plans_at_goal=6, horizon=6, finalists=2, repeats=2)
