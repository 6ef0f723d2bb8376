"""Stable-Baselines3 policy classes around the networks of this package."""

from __future__ import annotations

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy, BaseModel
from stable_baselines3.common.type_aliases import Schedule
from stable_baselines3.sac.policies import SACPolicy
from torch import Tensor

from tactile_kit.agents.config import NetworkConfig
from tactile_kit.agents.networks import (
    CriticEnsemble,
    GaussianPolicy,
    InputLayout,
    ObservationFeatures,
    RunningNorm,
    ValueNetwork,
)


class HandActorCriticPolicy(ActorCriticPolicy):
    """PPO's policy: separate actor and critic on one observation, sigma independent of the state.

    Args beyond SB3's: ``layout`` of the actor, the observation's first terms, and ``critic_layout``, all of it;
    ``actor`` and ``critic`` layers, ``bounded``, ``log_std`` and ``rest`` of the actor; ``critic_rate``, the critic's
    own learning rate (None: one rate for both).
    """

    def __init__(
        self,
        observation_space: spaces.Space,
        action_space: spaces.Space,
        lr_schedule: Schedule,
        *,
        layout: InputLayout,
        critic_layout: InputLayout,
        actor: NetworkConfig,
        critic: NetworkConfig,
        bounded: bool,
        log_std: float,
        rest: tuple[float, ...] | None = None,
        critic_rate: float | None = None,
        **kwargs: Any,
    ) -> None:
        self._networks = (layout, critic_layout, actor, critic, bounded, log_std, rest, critic_rate)
        super().__init__(
            observation_space,
            action_space,
            lr_schedule,
            features_extractor_class=ObservationFeatures,
            features_extractor_kwargs={"layout": critic_layout},
            share_features_extractor=True,
            **kwargs,
        )

    def _build(self, lr_schedule: Schedule) -> None:
        layout, _, actor, critic, bounded, log_std, rest, critic_rate = self._networks
        size = int(self.action_space.shape[0])  # type: ignore[index]
        # SB3 makes one extractor, the critic's; the actor gets its own, around the same statistics
        other = self.features_extractor
        assert isinstance(other, ObservationFeatures)
        own = ObservationFeatures(self.observation_space, layout, other.norm)
        self.actor = GaussianPolicy(
            own, size, actor, squashed=False, bounded=bounded, log_std=log_std, rest=rest
        )
        self.critic = ValueNetwork(other, critic)
        self.log_std = self.actor.log_std  # SB3 logs its mean
        groups: list[dict[str, Any]] = [{"params": list(self.parameters())}]
        if critic_rate is not None:
            groups = [
                {"params": list(self.actor.parameters())},
                {"params": list(self.critic.parameters()), "lr": critic_rate},
            ]
        self.optimizer = self.optimizer_class(groups, lr=lr_schedule(1), **self.optimizer_kwargs)

    @property
    def norm(self) -> RunningNorm:
        return self.actor.features.norm

    def moments_and_values(self, obs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Mean ``(B, A)``, log sigma ``(A,)`` and value ``(B,)``, normalising once."""
        return self.heads(self.norm(obs))

    def heads(self, normalised: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """:meth:`moments_and_values` of observations that are normalised already."""
        mean, log_std = self.actor.moments(self.actor.features.embed(normalised))
        return mean, log_std, self.critic.embed(self.critic.features.embed(normalised)).squeeze(1)

    def forward(self, obs: Tensor, deterministic: bool = False) -> tuple[Tensor, Tensor, Tensor]:
        mean, log_std, values = self.moments_and_values(obs)
        distribution = self.action_dist.proba_distribution(mean, log_std)
        actions = distribution.get_actions(deterministic=deterministic)
        return actions, values[:, None], distribution.log_prob(actions)

    def evaluate_actions(self, obs: Tensor, actions: Tensor) -> tuple[Tensor, Tensor, Tensor | None]:
        mean, log_std, values = self.moments_and_values(obs)
        distribution = self.action_dist.proba_distribution(mean, log_std)
        return values[:, None], distribution.log_prob(actions), distribution.entropy()

    def get_distribution(self, obs: Tensor):
        return self.action_dist.proba_distribution(*self.actor.moments(self.actor.features(obs)))

    def predict_values(self, obs: Tensor) -> Tensor:
        return self.critic(obs)


class _SACActor(BaseModel):
    """SB3's frame around :class:`GaussianPolicy`."""

    def __init__(self, observation_space, action_space, network: GaussianPolicy) -> None:
        super().__init__(observation_space, action_space)
        self.network = network

    def forward(self, obs: Tensor, deterministic: bool = False) -> Tensor:
        if deterministic:
            return self.network.act(obs)
        return self.action_log_prob(obs)[0]

    def action_log_prob(self, obs: Tensor, noise: Tensor | None = None) -> tuple[Tensor, Tensor]:
        if noise is None:
            noise = torch.randn(len(obs), self.action_space.shape[0])  # type: ignore[index]
        return self.network.squashed_sample(self.network.features(obs), noise)


class _SACCritic(BaseModel):
    """SB3's frame around :class:`CriticEnsemble`."""

    def __init__(self, observation_space, action_space, network: CriticEnsemble) -> None:
        super().__init__(observation_space, action_space)
        self.network = network

    def forward(self, obs: Tensor, actions: Tensor) -> tuple[Tensor, ...]:
        return self.network(obs, actions)


class HandSACPolicy(SACPolicy):
    """SAC's policy: squashed Gaussian actor, an ensemble of layer-normalised critics, shared statistics.

    Args beyond SB3's: ``layout``, ``actor_config`` and ``critic_config`` layers, ``critics``, ``log_std``, ``rest``.
    """

    def __init__(
        self,
        observation_space: spaces.Space,
        action_space: spaces.Box,
        lr_schedule: Schedule,
        *,
        layout: InputLayout,
        actor_config: NetworkConfig,
        critic_config: NetworkConfig,
        critics: int,
        log_std: float,
        rest: tuple[float, ...] | None = None,
        **kwargs: Any,
    ) -> None:
        self._networks = (layout, actor_config, critic_config, critics, log_std, rest)
        self._norm: list[RunningNorm] = []  # in a list: not yet a module of this module
        super().__init__(observation_space, action_space, lr_schedule, **kwargs)

    def _extractor(self) -> ObservationFeatures:
        extractor = ObservationFeatures(
            self.observation_space, self._networks[0], self._norm[0] if self._norm else None
        )
        self._norm[:] = [extractor.norm]
        return extractor

    @property
    def norm(self) -> RunningNorm:
        return self._norm[0]

    def make_actor(self, features_extractor=None) -> _SACActor:  # type: ignore[override]
        _, config, _, _, log_std, rest = self._networks
        size = int(self.action_space.shape[0])  # type: ignore[index]
        network = GaussianPolicy(self._extractor(), size, config, squashed=True, log_std=log_std, rest=rest)
        return _SACActor(self.observation_space, self.action_space, network)

    def make_critic(self, features_extractor=None) -> _SACCritic:  # type: ignore[override]
        _, _, config, critics, _, _ = self._networks
        size = int(self.action_space.shape[0])  # type: ignore[index]
        network = CriticEnsemble(self._extractor(), size, config, critics)
        return _SACCritic(self.observation_space, self.action_space, network)
