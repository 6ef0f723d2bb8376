"""SAC with goal relabelling, learning while the simulators work.

A vector step is: start the workers on the next action, do the gradient steps on what is stored, then wait for the
workers. With one core collecting and one learning neither waits for long; the schedule is fixed, so runs repeat.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.type_aliases import RolloutReturn
from stable_baselines3.common.vec_env import VecEnv

from randomization import derive, stream
from tactile_kit.agents.config import SACConfig
from tactile_kit.agents.exploration import Exploration
from tactile_kit.agents.networks import InputLayout
from tactile_kit.agents.policies import HandSACPolicy
from tactile_kit.agents.replay import Batch, GoalReplay, joined
from tactile_kit.agents.state import (
    Means,
    Tensors,
    Values,
    pack,
    pack_numpy_generator,
    pack_optimizer,
    unpack,
    unpack_numpy_generator,
    unpack_optimizer,
)


class SAC(stable_baselines3.SAC):
    """Soft actor-critic on a reorientation vector environment.

    Args:
        env: the vector environment; its ``layout``, ``transition`` and, where present, ``encoding`` and
            ``config.reward`` are used.
        config: settings.
        seed: names every random stream of the learner; no global generator is read.
        rest: ``(A,)`` action an untrained policy takes on average.
    """

    algorithm = "sac"
    policy: HandSACPolicy  # type: ignore[assignment]
    replay_buffer: GoalReplay  # type: ignore[assignment]

    def __init__(
        self,
        env: VecEnv,
        config: SACConfig | None = None,
        *,
        seed: int = 0,
        rest: tuple[float, ...] | None = None,
    ) -> None:
        self.config = config = config or SACConfig()
        self.input_layout = self.critic_layout = layout = InputLayout.of_env(env)
        self.noise = torch.Generator().manual_seed(derive(seed, "learner", "noise"))
        self._rest = None if rest is None else torch.tensor(rest, dtype=torch.float32)
        self.exploration = Exploration(config.exploration, env.action_space.shape[0], self.noise)  # type: ignore[index]
        self.teacher: GoalReplay | None = None
        self._debt = 0.0  # gradient steps owed, for fractional ratios
        self._means = Means()
        self.replay_settings = replay = {
            "goal": env.layout.slice("goal"),  # type: ignore[attr-defined]
            "rng": stream(seed, "learner", "replay"),
            "random_goals": config.random_goals,
            "future_goals": config.future_goals,
            "future_steps": config.future_steps,
            "steps": config.return_steps,
            "gamma": config.gamma,
            **reward_of(env),
        }
        policy: dict[str, Any] = {
            "layout": layout,
            "actor_config": config.actor,
            "critic_config": config.critic,
            "critics": config.critics,
            "log_std": config.log_std,
            "rest": rest,
            "optimizer_kwargs": {"fused": True},
        }
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(derive(seed, "learner", "weights"))
            super().__init__(
                HandSACPolicy,
                env,
                learning_rate=config.learning_rate,
                buffer_size=config.capacity,
                learning_starts=0,
                batch_size=config.batch,
                tau=config.tau,
                gamma=config.gamma,
                train_freq=1,
                gradient_steps=0,  # they are done inside collect_rollouts
                ent_coef=f"auto_{config.initial_temperature}",
                target_entropy=config.target_entropy,
                replay_buffer_class=GoalReplay,  # type: ignore[arg-type]
                replay_buffer_kwargs=replay,
                policy_kwargs=policy,
                device="cpu",
            )
        assert self.ent_coef_optimizer is not None
        self.ent_coef_optimizer = torch.optim.Adam([self.log_ent_coef], lr=config.entropy_learning_rate)
        self.policy.set_training_mode(False)

    def learn_from(self, teacher: GoalReplay) -> None:
        """Draw a share of each batch from ``teacher``, and imitate it where the critics find its actions better."""
        self.teacher = teacher

    def set_random_seed(self, seed: int | None = None) -> None:
        """SB3's hook seeds global generators; this learner has its own."""

    # ---- collecting --------------------------------------------------------------------------------------------------
    @torch.no_grad()
    def explore(self, observations: np.ndarray) -> np.ndarray:
        """Actions sampled from the policy, ``(E, A) float32`` in [-1, 1]."""
        noise = self.exploration.draw(len(observations))
        actions = self.actor.network.act(torch.from_numpy(observations), noise)
        return self.exploration.regrasp(actions).numpy()

    def collect_rollouts(  # type: ignore[override]
        self,
        env: VecEnv,
        callback: BaseCallback,
        train_freq=None,
        replay_buffer=None,
        action_noise=None,
        learning_starts: int = 0,
        log_interval: int | None = None,
    ) -> RolloutReturn:
        """One vector step, with the gradient steps due done while the workers simulate."""
        assert self._last_obs is not None
        callback.on_rollout_start()
        observations = np.array(self._last_obs, dtype=np.float32)  # the environment may reuse its buffers
        actions = self.explore(observations)
        env.step_async(actions)
        if len(self.replay_buffer) >= max(self.config.warmup, 1):
            self._debt += self.config.updates
            due = int(self._debt)
            self._debt -= due
            if due:
                self.train(due)
        new_obs, _, dones, infos = env.step_wait()
        self.replay_buffer.add(observations, actions, env.transition)  # type: ignore[attr-defined]
        self.policy.norm.update(torch.from_numpy(observations))
        self._last_obs = new_obs  # type: ignore[assignment]
        self.num_timesteps += env.num_envs
        self._episode_num += int(np.sum(dones))
        self._update_info_buffer(infos, dones)
        callback.update_locals(locals())
        go_on = callback.on_step()
        callback.on_rollout_end()
        return RolloutReturn(env.num_envs, int(np.sum(dones)), continue_training=go_on)

    def iterate(self, callback: BaseCallback) -> bool:
        """One vector step with its gradient steps; False when the callback asks to stop."""
        assert self.env is not None
        return self.collect_rollouts(self.env, callback).continue_training

    @property
    def anchor(self) -> float:
        """Present weight of the distance from the rest action in the actor's loss."""
        config = self.config
        if self._rest is None:
            return 0.0
        left = 1.0 - self.num_timesteps / config.anchor_steps if config.anchor_steps else 0.0
        return max(config.anchor * left, config.anchor_floor)

    # ---- learning ----------------------------------------------------------------------------------------------------
    def train(self, gradient_steps: int, batch_size: int | None = None) -> None:
        """``gradient_steps`` updates of critics, actor, temperature and targets."""
        config = self.config
        actor, critic, target = self.actor.network, self.critic.network, self.critic_target.network
        critic_parameters = list(critic.parameters())
        target_parameters = list(target.parameters())
        norm = self.policy.norm
        size = batch_size or config.batch
        assert self.log_ent_coef is not None and self.ent_coef_optimizer is not None
        for _ in range(gradient_steps):
            batch = self._sample(size)
            noise = torch.randn(2, *batch.actions.shape, generator=self.noise)
            temperature = self.log_ent_coef.detach().exp()
            now, following = norm(batch.observations), norm(batch.next_observations)
            if config.bfloat16:  # once here, not in every layer that reads them
                now, following = now.bfloat16(), following.bfloat16()
            with torch.autocast("cpu", torch.bfloat16, enabled=config.bfloat16):
                with torch.no_grad():
                    action, density = actor.squashed_sample(actor.features.embed(following), noise[0])
                    value = (
                        target.embed(target.features.embed(following), action).amin(0) - temperature * density
                    )
                    wanted = batch.rewards + (1.0 - batch.terminated) * batch.discounts * value
                values = critic.embed(critic.features.embed(now), batch.actions)
                critic_loss = 0.5 * (values - wanted).square().mean(1).sum()
            self.critic.optimizer.zero_grad()
            critic_loss.backward()
            self.critic.optimizer.step()
            if self._n_updates % config.actor_every == 0:
                self._update_actor(now, batch.actions, noise[1], temperature, critic_parameters)
            with torch.no_grad():
                torch._foreach_lerp_(target_parameters, critic_parameters, config.tau)
            self._n_updates += 1
            self._means.add(critic_loss=critic_loss, value=values.mean(), reward_step=batch.rewards.mean())

    def _sample(self, size: int) -> Batch:
        """A batch, the teacher's share at its end."""
        if self.teacher is None:
            return self.replay_buffer.sample(size)
        shown = self._shown(size)
        return joined(self.replay_buffer.sample(size - shown), self.teacher.sample(shown))

    def _shown(self, size: int) -> int:
        return 0 if self.teacher is None else round(size * self.config.demonstration_share)

    def _update_actor(self, now, taken, noise, temperature, critic_parameters) -> None:
        actor, critic = self.actor.network, self.critic.network
        for parameter in critic_parameters:  # no gradients for weights that this loss does not move
            parameter.requires_grad_(False)
        with torch.autocast("cpu", torch.bfloat16, enabled=self.config.bfloat16):
            mean, log_std = actor.moments(actor.features.embed(now))
            action, density = actor.squash(mean, log_std, noise)
            value = critic.embed(critic.features.embed(now), action).amin(0)
            actor_loss = (temperature * density - value).mean()
            if self.anchor > 0:
                # critics know little beyond the first, holding policy: the actor leaves it only as fast as they learn
                actor_loss = actor_loss + self.anchor * (torch.tanh(mean) - self._rest).square().sum(1).mean()
            if self.config.clone > 0 and self.teacher is not None:
                own = slice(len(now) - self._shown(len(now)), None)
                with torch.no_grad():
                    shown = critic.embed(critic.features.embed(now[own]), taken[own]).amin(0)
                better = (shown > value[own].detach()).float()
                distance = (torch.tanh(mean[own]) - taken[own]).square().sum(1)
                actor_loss = actor_loss + self.config.clone * (better * distance).mean()
                self._means.add(cloned=better.mean())
        self.actor.optimizer.zero_grad()
        actor_loss.backward()
        self.actor.optimizer.step()
        for parameter in critic_parameters:
            parameter.requires_grad_(True)
        surplus = (density.detach() + self.target_entropy).mean()
        assert self.log_ent_coef is not None and self.ent_coef_optimizer is not None
        entropy_loss = -(self.log_ent_coef * surplus).sum()
        self.ent_coef_optimizer.zero_grad()
        entropy_loss.backward()
        self.ent_coef_optimizer.step()
        self._means.add(actor_loss=actor_loss, temperature=temperature.squeeze(), entropy=-density.mean())

    def metrics(self) -> dict[str, float]:
        """Means since the last call: losses, temperature, entropy; counts. Raises FloatingPointError on NaN."""
        return {**self._means.take(), "updates": self._n_updates, "replay": len(self.replay_buffer)}

    # ---- state -------------------------------------------------------------------------------------------------------
    def state(self) -> tuple[Tensors, Values]:
        """Everything but the replay memory (see ``replay_buffer.arrays``) that an exact resume needs."""
        assert self.log_ent_coef is not None and self.ent_coef_optimizer is not None
        tensors = pack("policy", self.policy.state_dict())
        tensors["temperature"] = self.log_ent_coef.detach().clone()
        tensors["noise"] = self.noise.get_state().clone()
        values: Values = {
            "steps": self.num_timesteps,
            "episodes": self._episode_num,
            "updates": self._n_updates,
            "debt": self._debt,
            "replay_rng": pack_numpy_generator(self.replay_buffer.rng),
        }
        for name, optimizer in self._optimizers().items():
            moments, values[name] = pack_optimizer(name, optimizer)
            tensors.update(moments)
        tensors |= pack("exploration", self.exploration.state())
        if self._last_obs is not None:
            tensors["observation"] = torch.from_numpy(np.array(self._last_obs, dtype=np.float32))
        return tensors, values

    def restore(self, tensors: Tensors, values: Values) -> None:
        """Inverse of :meth:`state`."""
        assert self.log_ent_coef is not None
        self.policy.load_state_dict(unpack("policy", tensors))
        with torch.no_grad():
            self.log_ent_coef.copy_(tensors["temperature"])
        self.noise.set_state(tensors["noise"])
        for name, optimizer in self._optimizers().items():
            unpack_optimizer(name, optimizer, tensors, values[name])
        self.num_timesteps, self._episode_num = values["steps"], values["episodes"]
        self._n_updates, self._debt = values["updates"], values["debt"]
        unpack_numpy_generator(self.replay_buffer.rng, values["replay_rng"])
        self.exploration.restore(unpack("exploration", tensors))
        if "observation" in tensors:
            self._last_obs = tensors["observation"].numpy().copy()

    def _optimizers(self) -> dict[str, torch.optim.Optimizer]:
        assert self.ent_coef_optimizer is not None
        return {
            "actor_optimizer": self.actor.optimizer,
            "critic_optimizer": self.critic.optimizer,
            "temperature_optimizer": self.ent_coef_optimizer,
        }


def reward_of(env: VecEnv) -> dict[str, float]:
    """Weight and clip of the rotation reward from the environment's configuration.

    Raises ValueError for a reward that relabelling does not know.
    """
    reward = env.config.reward  # type: ignore[attr-defined]
    if reward.arrival:
        raise ValueError(
            f"task.reward.arrival = {reward.arrival}: allowed is 0 for SAC, which relabels goals"
        )
    return {"rotation_weight": float(reward.rotation), "rotation_clip": float(reward.rotation_clip)}
