"""What PPO's update makes small: the clipped surrogate, the value error, and the distance to a teacher."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from tactile_kit.agents.config import PPOConfig
from tactile_kit.agents.gaussian import divergence_of, entropy_of, log_density
from tactile_kit.agents.policies import HandActorCriticPolicy
from tactile_kit.agents.rollout import Experience


class Aims(NamedTuple):
    """What all minibatches of one update have in common."""

    leads: bool  # the actor follows the returns
    taught: bool  # the actor follows its teacher
    log_std: Tensor  # (A,) of the policy that collected
    new: float  # share of sigma that is new noise in each action


class Minibatch(NamedTuple):
    """One gradient step's transitions ``rows (M,)`` and the statistics of their advantages."""

    rows: Tensor
    center: Tensor
    spread: Tensor

    @classmethod
    def of(cls, experience: Experience, rows: Tensor) -> Minibatch:
        advantages = experience.advantages[rows]
        return cls(rows, advantages.mean(), advantages.std() + 1e-8)


def objective(
    policy: HandActorCriticPolicy,
    config: PPOConfig,
    experience: Experience,
    batch: Minibatch,
    aims: Aims,
    part: slice,
) -> tuple[list[Tensor | None], dict[str, Tensor]]:
    """Gradients and figures of one part of a minibatch, in proportion to its size: all parts' sum is the whole's."""
    narrower = math.log(aims.new)
    rows = batch.rows[part]
    weight, own = len(rows) / len(batch.rows), experience.at(rows)
    with torch.autocast("cpu", torch.bfloat16, enabled=config.bfloat16):
        mean, log_std, value = policy.heads(own.inputs)
    advantage = (own.advantages - batch.center) / batch.spread
    density = log_density(own.actions, mean + own.left_over, log_std + narrower)
    ratio = (density - own.densities).exp()
    clipped = ratio.clamp(1.0 - config.clip, 1.0 + config.clip)
    value_loss = (value - own.returns).square().mean()
    loss = config.critic_coefficient * value_loss
    means = {"value_loss": value_loss}
    if aims.leads:  # otherwise a teacher may have acted so far from this policy that its ratio overflows
        means["policy_loss"] = policy_loss = -torch.min(advantage * ratio, advantage * clipped).mean()
        loss = loss + policy_loss - config.entropy * entropy_of(log_std)
    if aims.taught:
        apart = divergence_of(mean, aims.log_std, own.shown, aims.log_std)
        loss, means["teacher_divergence"] = loss + apart, apart
    gradients = torch.autograd.grad(weight * loss, policy.learned(), allow_unused=True)
    with torch.no_grad():
        means["divergence"] = divergence_of(mean, log_std + narrower, own.means, aims.log_std + narrower)
        means["clipped"] = ((ratio - 1.0).abs() > config.clip).float().mean()
    return list(gradients), {name: weight * value.detach() for name, value in means.items()}
