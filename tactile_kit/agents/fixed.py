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
    env, actor = learner.env, learner.policy.actor
    assert env is not None
    loud = (torch.arange(env.num_envs) % 2 == 0)[:, None]
    callback.on_rollout_start()
    for _ in range(learner.config.rollout):
        with torch.no_grad():
            seen = torch.from_numpy(np.asarray(learner._last_obs, dtype=np.float32))
            mean, log_std = actor.moments(actor.features(seen))
            left, fresh = learner.wander(log_std)
        _, dones, infos = learner.act(env, torch.where(loud, mean + left + fresh, mean))
        callback.update_locals(locals())
        if not callback.on_step():
            return False
    callback.on_rollout_end()
    return True
