"""Stable-Baselines3 policy classes around the networks of this package."""

from __future__ import annotations

from typing import Any

from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.type_aliases import Schedule
from torch import Tensor

from tactile_kit.agents.config import NetworkConfig
from tactile_kit.agents.networks import (
    GaussianPolicy,
    InputLayout,
    ObservationFeatures,
    RunningNorm,
    ValueNetwork,
)


class HandActorCriticPolicy(ActorCriticPolicy):
    """PPO's policy: separate actor and critic on one observation, sigma independent of the state.

    Args beyond SB3's: ``layout`` of the actor, the observation's first terms, and ``critic_layout``, all of it;
    ``actor`` and ``critic`` layers, ``log_std`` and ``rest`` of the actor; ``critic_rate``, the critic's
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
        log_std: float,
        rest: tuple[float, ...] | None = None,
        critic_rate: float | None = None,
        **kwargs: Any,
    ) -> None:
        self._networks = (layout, critic_layout, actor, critic, log_std, rest, critic_rate)
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
        layout, _, actor, critic, log_std, rest, critic_rate = self._networks
        size = int(self.action_space.shape[0])  # type: ignore[index]
        # SB3 makes one extractor, the critic's; the actor gets its own, around the same statistics
        other = self.features_extractor
        assert isinstance(other, ObservationFeatures)
        own = ObservationFeatures(self.observation_space, layout, other.norm)
        self.actor = GaussianPolicy(own, size, actor, squashed=False, log_std=log_std, rest=rest)
        self.critic = ValueNetwork(other, critic)
        self.log_std = self.actor.log_std  # SB3 logs its mean
        groups: list[dict[str, Any]] = [{"params": list(self.parameters())}]
        if critic_rate is not None:
            groups = [
                {"params": list(self.actor.parameters())},
                {"params": list(self.critic.parameters()), "lr": critic_rate},
            ]
        self.optimizer = self.optimizer_class(groups, lr=lr_schedule(1), **self.optimizer_kwargs)

    def learned(self) -> list[Tensor]:
        """All parameters, in the order of the optimiser's groups."""
        return [parameter for group in self.optimizer.param_groups for parameter in group["params"]]

    @property
    def norm(self) -> RunningNorm:
        return self.actor.features.norm

    def heads(self, normalised: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Mean ``(B, A)``, log sigma ``(A,)`` and value ``(B,)`` of observations that ``norm`` has normalised."""
        mean, log_std = self.actor.moments(self.actor.features.embed(normalised))
        return mean, log_std, self.critic.embed(self.critic.features.embed(normalised)).squeeze(1)

    def get_distribution(self, obs: Tensor):
        return self.action_dist.proba_distribution(*self.actor.moments(self.actor.features(obs)))

    def predict_values(self, obs: Tensor) -> Tensor:
        return self.critic(obs)
