"""PPO as the paper trains with it (section III-D; settings of the paper's website page).

Separate actor and critic on the same observation, one sigma a joint, and a learning rate that follows the
Kullback-Leibler divergence between the policy that collected and the one being updated, as in rl_games.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from randomization import derive, stream
from tactile_kit.agents.config import PPOConfig
from tactile_kit.agents.gaussian import adapted_rate, log_density
from tactile_kit.agents.networks import InputLayout
from tactile_kit.agents.noise import Noise
from tactile_kit.agents.objective import Aims, Minibatch, objective
from tactile_kit.agents.policies import HandActorCriticPolicy
from tactile_kit.agents.rollout import Rollout
from tactile_kit.agents.shards import Shards
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
from tactile_kit.agents.teacher import MINIBATCH, Lessons


class PPO(stable_baselines3.PPO):
    """Proximal policy optimisation on a reorientation vector environment.

    Args:
        env: the vector environment; its ``layout`` and, where present, ``encoding`` are used.
        config: settings.
        seed: names every random stream of the learner; no global generator is read.
        rest: ``(A,)`` action an untrained policy takes on average.
        threads: in how many parts environments and minibatches are worked on at a time; results depend on it as on
            any order of sums.

    Attributes:
        ceiling: of log sigma, from outside.
    """

    policy: HandActorCriticPolicy  # type: ignore[assignment]
    rollout_buffer: Rollout

    def __init__(
        self,
        env: VecEnv,
        config: PPOConfig | None = None,
        *,
        seed: int = 0,
        rest: tuple[float, ...] | None = None,
        threads: int = 1,
    ) -> None:
        self.config = config = config or PPOConfig()
        self.shards = Shards(threads)
        transitions = config.rollout * env.num_envs
        if transitions < config.minibatch and transitions % 2:
            raise ValueError(f"a roll-out of {transitions} transitions is too small for PPO")
        everything = InputLayout.of_env(env)
        self.input_layout = layout = everything.without(getattr(env, "private", ()))
        self.critic_layout = everything
        actions = env.action_space.shape[0]  # type: ignore[index]
        self.noise = Noise(env.num_envs, actions, config.noise_correlation, derive(seed, "learner", "noise"))
        self.order = stream(seed, "learner", "minibatches")
        self.lessons: Lessons | None = None
        self.rate = config.learning_rate
        self.ceiling = math.inf
        self._means = Means()
        policy: dict[str, Any] = {
            "layout": layout,
            "critic_layout": everything,
            "actor": config.actor,
            "critic": config.critic,
            "log_std": config.log_std,
            "rest": rest,
            "critic_rate": config.critic_learning_rate,
            "optimizer_kwargs": {"fused": True, "eps": 1e-8, "weight_decay": config.weight_decay},
        }
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(derive(seed, "learner", "weights"))
            super().__init__(
                HandActorCriticPolicy,
                env,
                learning_rate=config.learning_rate,
                n_steps=config.rollout,
                batch_size=min(config.minibatch, transitions),
                n_epochs=config.epochs,
                gamma=config.gamma,
                gae_lambda=config.gae_lambda,
                clip_range=config.clip,
                ent_coef=config.entropy,
                vf_coef=config.critic_coefficient,
                max_grad_norm=config.max_gradient_norm,
                rollout_buffer_class=Rollout,
                rollout_buffer_kwargs={"precision": torch.bfloat16 if config.bfloat16 else torch.float32},
                policy_kwargs=policy,
                device="cpu",
            )
        self.policy.set_training_mode(False)

    def set_random_seed(self, seed: int | None = None) -> None:
        """SB3's hook seeds global generators; this learner has its own."""

    # ---- collecting --------------------------------------------------------------------------------------------------
    def collect_rollouts(  # type: ignore[override]
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: Rollout, n_rollout_steps: int
    ) -> bool:
        """Fill the roll-out buffer; episodes ended by time count the value of what they did not see."""
        assert self._last_obs is not None
        callback.on_rollout_start()
        buffer = rollout_buffer
        buffer.reset()
        self.policy.actor.log_std.data.clamp_(max=self.ceiling)
        log_std = self.policy.actor.log_std.detach().clone()
        dones = self._last_episode_starts
        for step in range(n_rollout_steps):
            buffer.observations[step] = self._last_obs  # a copy: the environment may reuse its buffers
            values = self._look(step)
            mean = buffer.means[step]
            left, fresh = self.noise.draw(log_std)
            buffer.left_over[step] = left
            density = log_density(mean + left + fresh, mean + left, log_std + math.log(self.noise.new))
            if lessons := self.taught:
                buffer.shown[step], mean = lessons.show(mean, self.num_timesteps)
            actions = mean + left + fresh
            starts = self._last_episode_starts
            rewards, dones, infos = self.act(env, actions)
            rewards = self._bootstrap(np.array(rewards, dtype=np.float32), infos, dones)
            buffer.put(actions, rewards, starts, values, density)  # type: ignore[arg-type]
            callback.update_locals(locals())
            if not callback.on_step():
                return False
        with torch.no_grad():
            last = self.policy.predict_values(torch.from_numpy(np.array(self._last_obs, dtype=np.float32)))
        buffer.compute_returns_and_advantage(last_values=last, dones=dones)  # type: ignore[arg-type]
        callback.on_rollout_end()
        return True

    def act(self, env: VecEnv, actions: torch.Tensor) -> tuple[np.ndarray, np.ndarray, list[dict]]:
        """One step of all environments; returns rewards ``(E,)``, dones ``(E,)`` and infos."""
        self._last_obs, rewards, dones, infos = env.step(actions.clamp(-1.0, 1.0).numpy())  # type: ignore[assignment]
        self._last_episode_starts = dones
        self.num_timesteps += env.num_envs
        ended = np.flatnonzero(dones)
        self._update_info_buffer([infos[i] for i in ended], dones[ended])
        self.noise.forget(dones)
        return rewards, dones, infos

    def _look(self, step: int) -> torch.Tensor:
        """Inputs and means of a step's observations to the buffer; returns values ``(E,)``.

        In the update's own precision, so that the update need not look again: else rounding alone would pass for
        divergence, the more the smaller sigma is.
        """
        buffer = self.rollout_buffer
        observations = torch.from_numpy(buffer.observations[step])

        def look(part: slice) -> torch.Tensor:
            with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=self.config.bfloat16):
                inputs = buffer.inputs[step, part]
                inputs.copy_(self.policy.norm(observations[part]))
                buffer.means[step, part], _, values = self.policy.heads(inputs)
                return values

        return torch.cat(self.shards.run(look, len(observations)))

    def _bootstrap(self, rewards: np.ndarray, infos: list[dict], dones: np.ndarray) -> np.ndarray:
        cut = [i for i in np.flatnonzero(dones) if infos[i].get("TimeLimit.truncated", False)]
        if cut:
            terminal = np.stack([infos[i]["terminal_observation"] for i in cut]).astype(np.float32)
            with torch.no_grad():
                rewards[cut] += (
                    self.gamma * self.policy.predict_values(torch.from_numpy(terminal)).squeeze(1).numpy()
                )
        return rewards

    def iterate(self, callback: BaseCallback) -> bool:
        """One roll-out and its update; False when the callback asked to stop."""
        assert self.env is not None
        if self.num_timesteps < self.config.fixed_steps:
            return self._act_only(callback)
        go_on = self.collect_rollouts(self.env, callback, self.rollout_buffer, self.n_steps)
        if go_on:
            self.train()
        return go_on

    def _act_only(self, callback: BaseCallback) -> bool:
        """A roll-out without an update, in which the environment's estimator alone learns.

        Every other environment acts without noise, as an evaluation does, the rest with the policy's sigma: the
        estimator sees more than one way to move.
        """
        env, actor = self.env, self.policy.actor
        assert env is not None
        loud = (torch.arange(env.num_envs) % 2 == 0)[:, None]
        callback.on_rollout_start()
        for _ in range(self.config.rollout):
            with torch.no_grad():
                seen = torch.from_numpy(np.asarray(self._last_obs, dtype=np.float32))
                mean, log_std = actor.moments(actor.features(seen))
                left, fresh = self.noise.draw(log_std)
            _, dones, infos = self.act(env, torch.where(loud, mean + left + fresh, mean))
            callback.update_locals(locals())
            if not callback.on_step():
                return False
        callback.on_rollout_end()
        return True

    # ---- learning ----------------------------------------------------------------------------------------------------
    def train(self) -> None:
        """Epochs of minibatch updates on the roll-out, then the normaliser takes in its observations."""
        config, policy, optimizer = self.config, self.policy, self.policy.optimizer
        experience, lessons = self.rollout_buffer.experience(), self.taught
        count = len(experience.actions)
        leads = self.leads
        aims = Aims(leads, lessons is not None, policy.actor.log_std.detach().clone(), self.noise.new)
        batches = max(count // (min(self.batch_size, MINIBATCH) if lessons else self.batch_size), 1)
        for _ in range(config.epochs):
            for chosen in np.array_split(self.order.permutation(count), batches):
                batch = Minibatch.of(experience, torch.from_numpy(chosen))
                share = partial(objective, policy, config, experience, batch, aims)
                means = self._gradients(self.shards.run(share, len(chosen)))
                for group in optimizer.param_groups:
                    torch.nn.utils.clip_grad_norm_(group["params"], config.max_gradient_norm)
                if leads:
                    divergence, bounds = float(means["divergence"]), config.learning_rate_bounds
                    self.rate = adapted_rate(self.rate, divergence, config.kl_threshold, bounds)
                rate = lessons.learning_rate(self.num_timesteps) if lessons else self.rate
                optimizer.param_groups[0]["lr"] = rate
                optimizer.step()
                self._n_updates += 1
                self._means.add(**means)
        returns = experience.returns
        explained = 1.0 - (returns - experience.values).var() / returns.var().clamp_min(1e-12)
        sigma = policy.actor.log_std.exp().mean()
        self._means.add(explained_variance=explained, sigma=sigma, value=returns.mean())
        policy.norm.update(torch.from_numpy(self.rollout_buffer.observations).flatten(0, 1))

    def _gradients(
        self, shares: list[tuple[list[torch.Tensor | None], dict[str, torch.Tensor]]]
    ) -> dict[str, Any]:
        """Put the sum of the shares' gradients into the parameters; returns the sum of their figures."""
        for parameter, *gradients in zip(self.policy.learned(), *(share[0] for share in shares), strict=True):
            known = [gradient for gradient in gradients if gradient is not None]
            parameter.grad = sum(known[1:], known[0]) if known else None
        return {name: sum(share[1][name] for share in shares) for name in shares[0][1]}

    @property
    def taught(self) -> Lessons | None:
        """The lessons, while the policy follows its teacher still and not yet its returns."""
        return self.lessons if self.lessons is not None and self.lessons.go_on(self.num_timesteps) else None

    @property
    def leads(self) -> bool:
        """Whether the policy follows its returns."""
        return not self.taught and self.num_timesteps > self.config.fixed_steps + self.config.critic_steps

    def metrics(self) -> dict[str, float]:
        """Means since the last call: losses, divergence, sigma, learning rate. Raises FloatingPointError on NaN."""
        return {**self._means.take(), "learning_rate": self.rate, "updates": self._n_updates}

    # ---- state -------------------------------------------------------------------------------------------------------
    def state(self) -> tuple[Tensors, Values]:
        """Everything an exact resume at a roll-out boundary needs."""
        tensors = pack("policy", self.policy.state_dict())
        moments, rates = pack_optimizer("optimizer", self.policy.optimizer)
        tensors.update(moments)
        tensors.update(self.noise.state())
        if self._last_obs is not None:
            tensors["observation"] = torch.from_numpy(np.array(self._last_obs, dtype=np.float32))
            tensors["episode_starts"] = torch.from_numpy(np.array(self._last_episode_starts, dtype=bool))
        values: Values = {
            "steps": self.num_timesteps,
            "updates": self._n_updates,
            "rate": self.rate,
            "optimizer": rates,
            "order": pack_numpy_generator(self.order),
        }
        return tensors, values

    def restore(self, tensors: Tensors, values: Values) -> None:
        """Inverse of :meth:`state`."""
        self.policy.load_state_dict(unpack("policy", tensors))
        unpack_optimizer("optimizer", self.policy.optimizer, tensors, values["optimizer"])
        self.noise.restore(tensors)
        unpack_numpy_generator(self.order, values["order"])
        self.num_timesteps, self._n_updates, self.rate = values["steps"], values["updates"], values["rate"]
        if "observation" in tensors:
            self._last_obs = tensors["observation"].numpy().copy()
            self._last_episode_starts = tensors["episode_starts"].numpy().copy()
