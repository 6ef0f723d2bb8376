"""PPO as the paper trains with it (section III-D; settings of the paper's website page).

Separate actor and critic on the same observation, one sigma a joint, and a learning rate that follows the
Kullback-Leibler divergence between the policy that collected and the one being updated, as in rl_games.

The noise may be correlated in time. What is left of the last action's noise then shifts the mean of the next, and the
density of an action is that of the new part alone (Korenkevych et al. 2019), so that the update stays exact.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from randomization import derive, stream
from tactile_kit.agents import fixed
from tactile_kit.agents.config import PPOConfig
from tactile_kit.agents.gaussian import adapted_rate, divergence_of, entropy_of, log_density
from tactile_kit.agents.networks import InputLayout
from tactile_kit.agents.policies import HandActorCriticPolicy
from tactile_kit.agents.rollout import Experience, Rollout
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
from tactile_kit.agents.teacher import MINIBATCH, Teacher, learning_rate, led


class Aims(NamedTuple):
    """What all minibatches of one update have in common."""

    leads: bool  # the actor follows the returns
    taught: bool  # the actor follows its teacher
    log_std: torch.Tensor  # (A,) of the policy that collected


class Minibatch(NamedTuple):
    """One gradient step's transitions ``rows (M,)`` and the statistics of their advantages."""

    rows: torch.Tensor
    center: torch.Tensor
    spread: torch.Tensor


Share = tuple[list[torch.Tensor | None], dict[str, torch.Tensor]]  # gradients, and what is reported


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
        log_std: ceiling of log sigma, from outside.
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
        self.noise = torch.Generator().manual_seed(derive(seed, "learner", "noise"))
        self.order = stream(seed, "learner", "minibatches")
        self.teacher: Teacher | None = None
        self.rate = config.learning_rate
        self.log_std = math.inf
        self._means = Means()
        self._new = (
            1.0 - config.noise_correlation**2
        ) ** 0.5  # share of an action's sigma that is not left over
        self._wander = torch.zeros(env.num_envs, env.action_space.shape[0])  # type: ignore[index]
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
        self.policy.actor.log_std.data.clamp_(max=self.log_std)
        log_std = self.policy.actor.log_std.detach().clone()
        dones = self._last_episode_starts
        for step in range(n_rollout_steps):
            buffer.observations[step] = self._last_obs  # a copy: the environment may reuse its buffers
            values = self._look(step)
            mean = buffer.means[step]
            left, fresh = self.wander(log_std)
            buffer.left_over[step] = left
            density = log_density(mean + left + fresh, mean + left, log_std + math.log(self._new))
            if self.taught:
                buffer.shown[step] = shown = self.teacher.actions()  # type: ignore[union-attr]
                mean = torch.where(led(self._lessons(), env.num_envs)[:, None], shown, mean)
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

    def wander(self, log_std: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """This step's noise ``(E, A)``: what is left of the last step's, and what is new. log sigma ``(A,)``."""
        left = self.config.noise_correlation * self._wander
        fresh = self._new * log_std.exp() * torch.randn(left.shape, generator=self.noise)
        self._wander = left + fresh
        return left, fresh

    def act(self, env: VecEnv, actions: torch.Tensor) -> tuple[np.ndarray, np.ndarray, list[dict]]:
        """One step of all environments; returns rewards ``(E,)``, dones ``(E,)`` and infos."""
        self._last_obs, rewards, dones, infos = env.step(actions.clamp(-1.0, 1.0).numpy())  # type: ignore[assignment]
        self._last_episode_starts = dones
        self.num_timesteps += env.num_envs
        ended = np.flatnonzero(dones)
        self._update_info_buffer([infos[i] for i in ended], dones[ended])
        self._wander[torch.from_numpy(np.asarray(dones, dtype=bool))] = 0.0
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
            return fixed.roll_out(self, callback)
        go_on = self.collect_rollouts(self.env, callback, self.rollout_buffer, self.n_steps)
        if go_on:
            self.train()
        return go_on

    # ---- learning ----------------------------------------------------------------------------------------------------
    def train(self) -> None:
        """Epochs of minibatch updates on the roll-out, then the normaliser takes in its observations."""
        experience, aims = self.rollout_buffer.experience(), self._aims()
        count = len(experience.actions)
        batches = max(count // (min(self.batch_size, MINIBATCH) if aims.taught else self.batch_size), 1)
        for _ in range(self.config.epochs):
            for chosen in np.array_split(self.order.permutation(count), batches):
                self._gradient_step(experience, _minibatch(experience, torch.from_numpy(chosen)), aims)
        returns = experience.returns
        explained = 1.0 - (returns - experience.values).var() / returns.var().clamp_min(1e-12)
        sigma = self.policy.actor.log_std.exp().mean()
        self._means.add(explained_variance=explained, sigma=sigma, value=returns.mean())
        self.policy.norm.update(torch.from_numpy(self.rollout_buffer.observations).flatten(0, 1))

    def _aims(self) -> Aims:
        return Aims(self.leads, self.taught, self.policy.actor.log_std.detach().clone())

    def _gradient_step(self, experience: Experience, batch: Minibatch, aims: Aims) -> None:
        optimizer = self.policy.optimizer
        shares = self.shards.run(partial(self._share, experience, batch, aims), len(batch.rows))
        for parameter, *gradients in zip(self._parameters(), *(share[0] for share in shares), strict=True):
            known = [gradient for gradient in gradients if gradient is not None]
            parameter.grad = sum(known[1:], known[0]) if known else None
        means = {name: sum(share[1][name] for share in shares) for name in shares[0][1]}
        for group in optimizer.param_groups:
            torch.nn.utils.clip_grad_norm_(group["params"], self.config.max_gradient_norm)
        if aims.leads:
            divergence, bounds = float(means["divergence"]), self.config.learning_rate_bounds
            self.rate = adapted_rate(self.rate, divergence, self.config.kl_threshold, bounds)
        optimizer.param_groups[0]["lr"] = learning_rate(self._lessons()) if aims.taught else self.rate
        optimizer.step()
        self._n_updates += 1
        self._means.add(**means)  # type: ignore[arg-type]

    def _parameters(self) -> list[torch.Tensor]:
        return [parameter for group in self.policy.optimizer.param_groups for parameter in group["params"]]

    def _share(self, experience: Experience, batch: Minibatch, aims: Aims, part: slice) -> Share:
        """Gradients and means of one part of a minibatch, in proportion to its size: all parts' sum is the whole's."""
        config, narrower = self.config, math.log(self._new)
        rows = batch.rows[part]
        weight, own = len(rows) / len(batch.rows), experience.at(rows)
        with torch.autocast("cpu", torch.bfloat16, enabled=config.bfloat16):
            mean, log_std, value = self.policy.heads(own.inputs)
        advantage = (own.advantages - batch.center) / batch.spread
        density = log_density(own.actions, mean + own.left_over, log_std + narrower)
        ratio = (density - own.densities).exp()
        clipped = ratio.clamp(1.0 - config.clip, 1.0 + config.clip)
        policy_loss = -torch.min(advantage * ratio, advantage * clipped).mean()
        value_loss = (value - own.returns).square().mean()
        loss = config.critic_coefficient * value_loss
        means = {"policy_loss": policy_loss, "value_loss": value_loss}
        if aims.leads:
            entropy = entropy_of(log_std)
            loss = loss + policy_loss - config.entropy * entropy
        if aims.taught:
            apart = divergence_of(mean, aims.log_std, own.shown, aims.log_std)
            loss, means["teacher_divergence"] = loss + apart, apart
        gradients = torch.autograd.grad(weight * loss, self._parameters(), allow_unused=True)
        with torch.no_grad():
            means["divergence"] = divergence_of(mean, log_std + narrower, own.means, aims.log_std + narrower)
            means["clipped"] = ((ratio - 1.0).abs() > config.clip).float().mean()
        return list(gradients), {name: weight * value.detach() for name, value in means.items()}

    # ---- being taught ------------------------------------------------------------------------------------------------
    def _lessons(self) -> float:
        """Share of the lessons that is over."""
        return self.num_timesteps / self.config.taught_steps

    @property
    def taught(self) -> bool:
        """Whether the policy follows its teacher still, and not yet its returns."""
        lessons = self.config.taught_steps if self.teacher is not None else 0
        return lessons > 0 and self.num_timesteps <= lessons

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
        tensors["noise"] = self.noise.get_state().clone()
        tensors["wander"] = self._wander.clone()
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
        self.noise.set_state(tensors["noise"])
        if "wander" in tensors:
            self._wander = tensors["wander"].clone()
        unpack_numpy_generator(self.order, values["order"])
        self.num_timesteps, self._n_updates, self.rate = values["steps"], values["updates"], values["rate"]
        if "observation" in tensors:
            self._last_obs = tensors["observation"].numpy().copy()
            self._last_episode_starts = tensors["episode_starts"].numpy().copy()


def _minibatch(experience: Experience, rows: torch.Tensor) -> Minibatch:
    advantages = experience.advantages[rows]
    return Minibatch(rows, advantages.mean(), advantages.std() + 1e-8)
