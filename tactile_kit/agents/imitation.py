"""Imitating demonstrated actions: before reinforcement learning, and beside it (Rajeswaran et al. 2018)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from tactile_kit.agents.networks import GaussianPolicy

BATCH = 1024
RATE = 1e-3  # falls to zero over the imitation
WEIGHT_DECAY = 1e-4
RAMP = 200  # gradient steps over which the rate rises


class Examples:
    """Demonstrated observations ``(N, D)`` and actions ``(N, A)``, drawn from in batches."""

    def __init__(self, observations: np.ndarray, actions: np.ndarray, order: np.random.Generator) -> None:
        self.observations, self.actions = torch.from_numpy(observations), torch.from_numpy(actions)
        self.order = order

    def __len__(self) -> int:
        return len(self.actions)

    def batch(self, size: int) -> tuple[Tensor, Tensor]:
        """``size`` examples, drawn with replacement."""
        chosen = torch.from_numpy(self.order.integers(len(self), size=size))
        return self.observations[chosen], self.actions[chosen]


def distance(actor: GaussianPolicy, observations: Tensor, actions: Tensor, bfloat16: bool = False) -> Tensor:
    """Mean absolute distance of the policy's mean from demonstrated actions; less torn by two ways of doing it than
    the squared one."""
    with torch.autocast("cpu", torch.bfloat16, enabled=bfloat16):
        mean, _ = actor.moments(actor.features(observations))
    return (mean.float() - actions).abs().mean()


def imitate(
    actor: GaussianPolicy,
    examples: Examples,
    epochs: int,
    bfloat16: bool = False,
    report: Callable[[str], None] = lambda line: None,
) -> float:
    """Fit the mean of ``actor`` to ``examples``; the observation's statistics become theirs. Returns the distance."""
    actor.features.norm.update(examples.observations)
    parameters = [parameter for name, parameter in actor.named_parameters() if name != "log_std"]
    optimizer = torch.optim.AdamW(parameters, RATE, weight_decay=WEIGHT_DECAY, fused=True)
    size = min(BATCH, len(examples))
    batches = len(examples) // size
    total, done, mean = epochs * batches, 0, math.nan
    for epoch in range(epochs):
        order, losses = examples.order.permutation(len(examples)), 0.0
        for part in range(batches):
            at = torch.from_numpy(order[part * size : (part + 1) * size])
            rate = RATE * min(1.0, (done + 1) / RAMP) * 0.5 * (1.0 + math.cos(math.pi * done / total))
            for group in optimizer.param_groups:
                group["lr"] = rate
            loss = distance(actor, examples.observations[at], examples.actions[at], bfloat16)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            losses += loss.item()
            done += 1
        mean = losses / batches
        report(f"imitation {epoch + 1}/{epochs}: {mean:.4f} from {len(examples):,} demonstrated actions")
    return mean
