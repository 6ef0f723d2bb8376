"""Training episodes go on where they were: what a resumed run needs of the environment."""

import numpy as np
import pytest

from tactile_kit.task.config import TaskConfig
from tactile_kit.task.vec_env import ReorientVecEnv

CONFIG = TaskConfig(objects="cube", grasps=2, horizon=3)


def started(env: ReorientVecEnv) -> list:
    env.reset()
    return [(env.state.goal[i].copy(), env.episodes.present[i].seed) for i in range(env.num_envs)]


def test_state_names_the_announced_episodes_and_brings_them_back():
    env = ReorientVecEnv(CONFIG, num_envs=2, num_workers=0, seed=3)
    env.reset()
    for _ in range(7):  # past two episode ends
        env.step(np.zeros((2, 12), np.float32))
    kept = env.get_state()
    expected = started(env)
    env.close()
    other = ReorientVecEnv(CONFIG, num_envs=2, num_workers=0, seed=3)
    first = started(other)
    other.set_state(kept)
    found = started(other)
    other.close()
    assert [seed for _, seed in found] == [seed for _, seed in expected]
    assert [seed for _, seed in found] != [seed for _, seed in first]
    for (goal, _), (wanted, _) in zip(found, expected, strict=True):
        np.testing.assert_array_equal(goal, wanted)


def test_state_of_another_size_is_refused():
    env = ReorientVecEnv(CONFIG, num_envs=1, num_workers=0)
    with pytest.raises(ValueError, match="3 environments: allowed are 1"):
        env.set_state({"next_episode": np.zeros(3, np.int64)})
    env.close()
