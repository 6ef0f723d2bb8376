"""PPO's roll-out, with everything the update would otherwise compute a second time."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from stable_baselines3.common.buffers import RolloutBuffer
from torch import Tensor


class Experience(NamedTuple):
    """Transitions in one row each, ``(N, ...)``.

    ``inputs (N, D)`` normalised observations in the precision of the update, ``actions (N, A)``; ``means (N, A)`` of
    the policy that collected and the noise ``left_over (N, A)`` that shifted them, ``densities (N,)`` of the actions;
    ``advantages (N,)``, ``returns (N,)``, ``values (N,)``; ``shown (N, A)``, the teacher's actions.
    """

    inputs: Tensor
    actions: Tensor
    means: Tensor
    left_over: Tensor
    densities: Tensor
    advantages: Tensor
    returns: Tensor
    values: Tensor
    shown: Tensor

    def at(self, rows: Tensor) -> Experience:
        """The transitions ``rows (M,) int64``."""
        return Experience(*(part.index_select(0, rows) for part in self))


class Rollout(RolloutBuffer):
    """SB3's buffer, ``(T, E, ...)``, whose arrays are used over and over.

    Args:
        precision: of ``inputs``, the normalised observations.

    Attributes:
        inputs, means, left_over, shown: as in :class:`Experience`, ``(T, E, ...)``.
    """

    def __init__(self, *given: Any, precision: torch.dtype = torch.float32, **settings: Any) -> None:
        self.inputs = torch.zeros(0, dtype=precision)
        super().__init__(*given, **settings)
        shape = (self.buffer_size, self.n_envs)
        self.inputs = torch.zeros(*shape, *self.obs_shape, dtype=precision)  # type: ignore[misc]
        self.means, self.left_over, self.shown = (torch.zeros(*shape, self.action_dim) for _ in range(3))

    def reset(self) -> None:
        """Begin a roll-out; every entry will be written anew."""
        if not len(self.inputs):
            super().reset()
        self.pos, self.full, self.generator_ready = 0, False, False

    def put(
        self, actions: Tensor, rewards: np.ndarray, starts: np.ndarray, values: Tensor, densities: Tensor
    ) -> None:
        """The rest of a step whose observations, inputs, means and noise are in their places already."""
        step = self.pos
        self.actions[step], self.rewards[step], self.episode_starts[step] = actions.numpy(), rewards, starts
        self.values[step], self.log_probs[step] = values.numpy(), densities.numpy()
        self.pos += 1
        self.full = self.pos == self.buffer_size

    def experience(self) -> Experience:
        """All transitions, without a copy."""
        return Experience(
            self.inputs.flatten(0, 1), _flat(self.actions), self.means.flatten(0, 1), self.left_over.flatten(0, 1),
            _flat(self.log_probs), _flat(self.advantages), _flat(self.returns), _flat(self.values),
            self.shown.flatten(0, 1),
        )  # fmt: skip


def _flat(array: np.ndarray) -> Tensor:
    return torch.from_numpy(array).flatten(0, 1)
