"""Averaged weights: those that act, where the raw ones learn.

At a constant learning rate on small minibatches a recurrent estimator's weights rattle around where they should be;
their average over the last few hundred gradient steps is what a falling rate would reach, at any time.
"""

from __future__ import annotations

import torch
from torch import nn


class Average:
    """Keeps ``kept``'s parameters at the moving average of ``learning``'s.

    Args:
        kept: overwritten; learning: the same module, elsewhere.
        decay: of a gradient step, in [0, 1). At first the average is over the last tenth of the steps or so: what the
            weights were as they began must not weigh it down.
    """

    def __init__(self, kept: nn.Module, learning: nn.Module, decay: float) -> None:
        self.kept, self.learning, self.decay = list(kept.parameters()), list(learning.parameters()), decay
        self.steps = 0

    @torch.no_grad()
    def update(self) -> None:
        """After a gradient step of ``learning``."""
        self.steps += 1
        share = max(1.0 - self.decay, 9.0 / (9.0 + self.steps))
        torch._foreach_lerp_(self.kept, self.learning, share)
