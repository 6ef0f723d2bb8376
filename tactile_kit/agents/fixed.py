"""A trained policy acts and does not learn, while the environment's estimator does.

The first stage of a tactile agent: the estimator learns what follows from a policy that already turns objects, told the
truth or, in closed loop, the estimate itself (``ecrl.rho_start``).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback

if TYPE_CHECKING:
    from tactile_kit.agents.ppo import PPO


def roll_out(learner: PPO, callback: BaseCallback) -> bool:
    """``config.rollout`` steps of every environment without an update; False when the callback asked to stop.

    Every other environment acts without noise, as an evaluation does, the rest with the policy's sigma: the estimator
    sees more than one way to move.
    """
    env, policy, config = learner.env, learner.policy, learner.config
    assert env is not None and learner._last_obs is not None
    loud = (torch.arange(env.num_envs) % 2 == 0)[:, None]
    callback.on_rollout_start()
    for _ in range(config.rollout):
        with torch.no_grad():
            features = policy.actor.features(
                torch.from_numpy(np.asarray(learner._last_obs, dtype=np.float32))
            )
            mean, log_std = policy.actor.moments(features)
            fresh = learner._new * log_std.exp() * torch.randn(mean.shape, generator=learner.noise)
            learner._wander = config.noise_correlation * learner._wander + fresh
            actions = torch.where(loud, mean + learner._wander, mean)
        observations, _, dones, infos = env.step(actions.clamp(-1.0, 1.0).numpy())
        learner.num_timesteps += env.num_envs
        learner._wander[torch.from_numpy(np.asarray(dones, dtype=bool))] = 0.0
        learner._update_info_buffer(infos, dones)
        learner._last_obs, learner._last_episode_starts = observations, dones  # type: ignore[assignment]
        callback.update_locals(locals())
        if not callback.on_step():
            return False
    callback.on_rollout_end()
    return True
