"""The noise of actions, which may be correlated in time.

What is left of the last action's noise then shifts the mean of the next, and the density of an action is that of the
new part alone (Korenkevych et al. 2019), so that updates stay exact.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from tactile_kit.agents.state import Tensors


class Noise:
    """Of ``num_envs`` environments and ``actions`` joints; ``correlation`` from one action to the next.

    Attributes:
        new: the share of an action's sigma that is not left over.
    """

    def __init__(self, num_envs: int, actions: int, correlation: float, seed: int) -> None:
        self.correlation, self.new = correlation, (1.0 - correlation**2) ** 0.5
        self._generator = torch.Generator().manual_seed(seed)
        self._last = torch.zeros(num_envs, actions)

    def draw(self, log_std: Tensor) -> tuple[Tensor, Tensor]:
        """This step's, ``(E, A)`` twice: what is left of the last step's, and what is new. log sigma ``(A,)``."""
        left = self.correlation * self._last
        fresh = self.new * log_std.exp() * torch.randn(left.shape, generator=self._generator)
        self._last = left + fresh
        return left, fresh

    def forget(self, dones: np.ndarray) -> None:
        """Nothing is left over where an episode ended, ``(E,) bool``."""
        self._last[torch.from_numpy(np.asarray(dones, dtype=bool))] = 0.0

    def state(self) -> Tensors:
        return {"noise": self._generator.get_state().clone(), "wander": self._last.clone()}

    def restore(self, tensors: Tensors) -> None:
        self._generator.set_state(tensors["noise"])
        self._last = tensors["wander"].clone()
