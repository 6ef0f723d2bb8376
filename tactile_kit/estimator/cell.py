"""The recurrent estimator cell: a residual ReLU MLP whose input contains the shape at its own pose estimate.

Paper, section II-D and figure 3; layer sizes from the paper's website. From the state s = (x̂, R̂, l) and
the joint measurements z a cell predicts residuals (δl, δx, δr) and adds them: R̂ <- exp(δr) R̂. R̂_0 is
given, x̂_0 and l_0 are learned. A second network predicts the two sigmas of the likelihood from l.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from tactile_kit.errors import EstimatorError
from tactile_kit.estimator.config import EstimatorConfig
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.estimator.step import LENGTH_SCALE
from tactile_kit.shape import Encoding

Apply = Callable[[Tensor], Tensor]

MEASUREMENTS = 144  # 6 samples of 12 joint angles and 12 control errors

OUTPUT_GAIN = 0.1  # the last layer starts small, so that an untrained cell is nearly still


def mlp(sizes: Sequence[int], gain: float = 1.0) -> nn.Sequential:
    """Linear layers with ReLU between them; the last one's initial weights are multiplied by ``gain``."""
    layers: list[nn.Module] = []
    for index, (inputs, outputs) in enumerate(itertools.pairwise(sizes)):
        layers.append(nn.Linear(inputs, outputs))
        if index < len(sizes) - 2:
            # He's initialisation: torch's default shrinks the signal by more than half in each ReLU layer
            nn.init.kaiming_normal_(layers[-1].weight, nonlinearity="relu")
            nn.init.zeros_(layers[-1].bias)
            layers.append(nn.ReLU())
    with torch.no_grad():
        layers[-1].weight.mul_(gain)
        layers[-1].bias.zero_()
    return nn.Sequential(*layers)


class EstimatorCell(nn.Module, ABC):
    """What every estimator f is: learned first state, a transition, sigmas. Kinds differ in what the transition sees.

    Args:
        config: layer sizes and switches.
        shape: the encoding's class or an instance of it; meshes are not read.
        inputs: numbers the transition sees beside the latent state.

    Attributes:
        shape: the encoding's class;
        x0: ``(3,)`` learned x̂_0 in units of LENGTH_SCALE; latent0: ``(n,)`` learned l_0.
    """

    def __init__(self, config: EstimatorConfig, shape: Any, inputs: int) -> None:
        super().__init__()
        self.config = config
        self.shape: type[Encoding] = shape if isinstance(shape, type) else type(shape)
        latent = config.latent
        self.transition = mlp((inputs + latent, *config.transition_hidden, latent + 6), OUTPUT_GAIN)
        self.sigma_net = mlp((latent, *config.sigma_hidden, 2), OUTPUT_GAIN)
        self.x0 = nn.Parameter(torch.zeros(3))
        self.latent0 = nn.Parameter(0.1 * torch.randn(latent))

    @abstractmethod
    def look(self, z: Tensor, started: Tensor, state: EstimatorState) -> list[Any]:
        """What each of T steps' measurements say without an estimate, whole sequences at a time.

        Args:
            z: ``(T, B, 144)`` rad; started: ``(T, B) bool``, steps that are an episode's first; state: before them.
        """

    @abstractmethod
    def step(
        self, state: EstimatorState, seen: Any, encoding: Any, mesh: Tensor, transition: Apply | None = None
    ) -> EstimatorState:
        """:meth:`forward` for measurements that :meth:`look` has already seen.

        ``transition`` stands in for the cell's own network, with the same weights: see ``repeated.Repeated``.
        """

    def initial(self, R0: Tensor) -> EstimatorState:
        """State at an episode's start: R̂ = R0 ``(B, 3, 3)``, learned x̂_0 and l_0."""
        count = len(R0)
        x = (LENGTH_SCALE * self.x0).expand(count, 3)
        return EstimatorState(x, R0.to(x.dtype), self.latent0.expand(count, -1))

    def forward(self, state: EstimatorState, z: Tensor, encoding: Any, mesh: Tensor) -> EstimatorState:
        """One update with a new measurement.

        Args:
            state: before; z: ``(B, 144)`` rad, see the task's observation;
            encoding: the shape encoding; mesh: ``(B,) int64`` index of the mesh given.

        Returns:
            The state after. Differentiable in everything but ``mesh``.
        """
        if z.shape[-1] != MEASUREMENTS:
            raise EstimatorError(f"measurements have {z.shape[-1]} entries, allowed: {MEASUREMENTS}")
        nowhere = torch.zeros(1, len(z), dtype=torch.bool)
        return self.step(state, self.look(z[None], nowhere, state)[0], encoding, mesh)

    def sigmas(self, state: EstimatorState) -> Tensor:
        """Predicted σ_v (in ``config.distance_unit``) and σ_R (rad), above ``sigma_floor``: ``(B, 2)``."""
        return self.sigmas_of(state.latent)

    def sigmas_of(self, latent: Tensor) -> Tensor:
        """:meth:`sigmas` from latent states ``(..., n)``; what a cell keeps behind the n is not read."""
        return (
            nn.functional.softplus(self.sigma_net(latent[..., : self.config.latent]))
            + self.config.sigma_floor
        )
