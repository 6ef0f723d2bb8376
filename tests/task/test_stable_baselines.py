"""Stable-Baselines3's own learners train in our environments as they come, batched and single."""

import gymnasium
import numpy as np
import pytest
import stable_baselines3 as sb3

import tactile_kit
from tactile_kit.task.config import TaskConfig

TASK = TaskConfig(objects="cube", encoding="pos", action="increment", horizon=6, grasps=2)
SMALL = {"device": "cpu", "seed": 0}
LEARNERS = {
    "PPO": lambda env: sb3.PPO("MlpPolicy", env, n_steps=16, batch_size=16, n_epochs=2, **SMALL),
    "SAC": lambda env: sb3.SAC("MlpPolicy", env, learning_starts=16, batch_size=16, buffer_size=200, **SMALL),
}


def compiled():
    physics = TASK.simulation.model_copy(update={"engine": "compiled"})
    return tactile_kit.make_vec(TASK.model_copy(update={"simulation": physics}), num_envs=4, num_workers=1)


ENVIRONMENTS = {
    "Bullet": lambda: tactile_kit.make_vec(TASK, num_envs=4, num_workers=0),
    "compiled": compiled,
    "single": lambda: gymnasium.make(tactile_kit.ENVIRONMENT, config=TASK),
}


@pytest.mark.parametrize("learner", LEARNERS)
@pytest.mark.parametrize("environment", ENVIRONMENTS)
def test_stable_baselines_trains(environment: str, learner: str) -> None:
    env = ENVIRONMENTS[environment]()
    try:
        model = LEARNERS[learner](env)
        before = [parameter.detach().clone() for parameter in model.policy.parameters()]
        model.learn(64)
        assert model.num_timesteps == 64 and len(model.ep_info_buffer) > 0  # episodes ended, and were told
        after = list(model.policy.parameters())
        assert all(np.isfinite(parameter.detach().numpy()).all() for parameter in after)
        assert any((old != new).any() for old, new in zip(before, after, strict=True))
        actions, _ = model.predict(model.get_env().reset(), deterministic=True)
        assert actions.shape[1:] == (12,) and np.abs(actions).max() <= 1
    finally:
        env.close()
