"""The recurrent estimator cell: a residual ReLU MLP whose input contains the shape at its own pose estimate.

Paper, section II-D and figure 3; layer sizes from the paper's website. From the state s = (x̂, R̂, l) and
the joint measurements z the cell predicts residuals (δl, δx, δr) and adds them: R̂ <- exp(δr) R̂. R̂_0 is
given, x̂_0 and l_0 are learned. A second network predicts the two sigmas of the likelihood from l.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from randomization import derive
from tactile_kit.estimator import so3
from tactile_kit.estimator.config import EstimatorConfig
from tactile_kit.estimator.errors import EstimatorError
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.estimator.turn import turned
from tactile_kit.hand.kinematics import MEAN_GRASP

Encode = Callable[[Tensor, Tensor, Tensor], Tensor]
Apply = Callable[[Tensor], Tensor]

SAMPLES, JOINTS = 6, 12
MEASUREMENTS = SAMPLES * 2 * JOINTS  # 144
POSE = 9

# Input scaling: fixed constants, because the sizes are known before the first roll-out and a running
# normalisation would move the recurrence under its feet. Joints move some 0.3 rad around the mean grasp; a
# control error of 0.2 rad saturates the torque; the object wanders a few centimetres, the size of most
# basis-point vectors.
JOINT_SCALE, ERROR_SCALE, LENGTH_SCALE = 0.3, 0.1, 0.03
# Output scaling: what an object does in one step of 0.1 s (half a turn takes some 2.5 s). The last layer
# starts small, so that an untrained cell is nearly still.
POSITION_STEP, ROTATION_STEP, OUTPUT_GAIN = 0.01, 0.1, 0.1
# No estimate may run away: an object 10 cm off is dropped (m, every axis), and turns by 0.1 rad a step.
FARTHEST, LARGEST_TURN, LARGEST_LATENT = 0.12, 1.5, 30.0


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


class EstimatorCell(nn.Module):
    """The estimator f.

    Args:
        config: layer sizes and switches.
        shape: the encoding's class or an instance of it: sizes and learned layer are read, meshes are not.

    Attributes:
        x0: ``(3,)`` learned x̂_0 in units of LENGTH_SCALE; latent0: ``(n,)`` learned l_0.
    """

    def __init__(self, config: EstimatorConfig, shape: Any) -> None:
        super().__init__()
        self.config = config
        self.shape_name: str = shape.name
        self.observation_size: int = shape.observation_size
        self.features: nn.Module | None = _learned_layer(shape)
        latent = config.latent
        self.encoder = mlp((MEASUREMENTS, *config.encoder_hidden, config.features))
        inputs = config.features + latent + shape.size + POSE
        self.transition = mlp((inputs, *config.transition_hidden, latent + 6), OUTPUT_GAIN)
        self.sigma_net = mlp((latent, *config.sigma_hidden, 2), OUTPUT_GAIN)
        self.x0 = nn.Parameter(torch.zeros(3))
        self.latent0 = nn.Parameter(0.1 * torch.randn(latent))
        mean, scale = _measurement_scaling()
        self.register_buffer("z_mean", mean)
        self.register_buffer("z_scale", scale)
        self.register_buffer("input_scale", _input_scaling(config, shape))

    def initial(self, R0: Tensor) -> EstimatorState:
        """State at an episode's start: R̂ = R0 ``(B, 3, 3)``, learned x̂_0 and l_0."""
        count = len(R0)
        x = (LENGTH_SCALE * self.x0).expand(count, 3)
        return EstimatorState(x, R0.to(x.dtype), self.latent0.expand(count, -1))

    def encode(self, z: Tensor, encoder: Apply | None = None) -> Tensor:
        """Measurement features: ``(..., 144)`` to ``(..., 32)``. Needs no state: sequences can go whole.

        ``encoder`` stands in for the cell's own network, with the same weights: see ``repeated.Repeated``.
        """
        if z.shape[-1] != MEASUREMENTS:
            raise EstimatorError(f"measurements have {z.shape[-1]} entries, allowed: {MEASUREMENTS}")
        return (encoder or self.encoder)((z - self.z_mean) / self.z_scale)

    def forward(self, state: EstimatorState, z: Tensor, encoding: Encode, mesh: Tensor) -> EstimatorState:
        """One update with a new measurement.

        Args:
            state: before; z: ``(B, 144)`` rad, see the task's observation;
            encoding: ``(x, R, mesh) -> (B, observation_size)``; mesh: ``(B,) int64`` index of the mesh given.

        Returns:
            The state after. Differentiable in everything but ``mesh``.
        """
        return self.step(state, self.encode(z), encoding, mesh)

    def step(
        self,
        state: EstimatorState,
        features: Tensor,
        encoding: Encode,
        mesh: Tensor,
        transition: Apply | None = None,
    ) -> EstimatorState:
        """:meth:`forward` for measurements that :meth:`encode` has already seen.

        ``transition`` stands in for the cell's own network, as ``encoder`` does there.
        """
        parts = [features, state.latent]
        if self.observation_size:
            seen = state.detach() if self.config.stop_gradient else state
            shape = encoding(seen.x, seen.R, mesh)
            parts.append(shape if self.features is None else self.features(shape / LENGTH_SCALE))
        parts += [state.x, so3.to_6d(state.R)]
        residual = (transition or self.transition)(torch.cat(parts, dim=-1) * self.input_scale)
        latent, move, turn = residual.split([self.config.latent, 3, 3], dim=-1)
        return EstimatorState(
            (state.x + POSITION_STEP * move).clamp(-FARTHEST, FARTHEST),
            turned(state.R, (ROTATION_STEP * turn).clamp(-LARGEST_TURN, LARGEST_TURN)),
            (state.latent + latent).clamp(-LARGEST_LATENT, LARGEST_LATENT),
        )

    def sigmas(self, state: EstimatorState) -> Tensor:
        """Predicted σ_v (in ``config.distance_unit``) and σ_R (rad), above ``sigma_floor``: ``(B, 2)``."""
        return self.sigmas_of(state.latent)

    def sigmas_of(self, latent: Tensor) -> Tensor:
        """:meth:`sigmas` from latent states ``(..., n)``."""
        return nn.functional.softplus(self.sigma_net(latent)) + self.config.sigma_floor


def _measurement_scaling() -> tuple[Tensor, Tensor]:
    grasp = torch.as_tensor(MEAN_GRASP, dtype=torch.float32)
    mean = torch.cat([grasp, torch.zeros(JOINTS)]).repeat(SAMPLES)
    scale = torch.tensor([JOINT_SCALE] * JOINTS + [ERROR_SCALE] * JOINTS).repeat(SAMPLES)
    return mean, scale


def _input_scaling(config: EstimatorConfig, shape: Any) -> Tensor:
    """Factors on the transition's inputs: lengths are divided by LENGTH_SCALE, the rest is of order one.

    Encodings hold lengths, but for the rotation that pos_rot and mesh carry and for learned features.
    """
    scale = torch.full((shape.size,), 1.0 if shape.size != shape.observation_size else 1.0 / LENGTH_SCALE)
    if shape.name in ("pos_rot", "mesh"):
        scale[3:POSE] = 1.0
    pose = torch.tensor([1.0 / LENGTH_SCALE] * 3 + [1.0] * 6)
    return torch.cat([torch.ones(config.features + config.latent), scale, pose])


def _learned_layer(shape: Any) -> nn.Module | None:
    """``shape.features()``, also of a class: the layer doesn't depend on the meshes."""
    layer = shape.features
    return layer(None) if isinstance(shape, type) else layer()


def new_cell(config: EstimatorConfig, shape: Any, seed: int) -> EstimatorCell:
    """A cell with fresh weights from a stream of ``seed``; torch's global generator is left as it was."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(derive(seed, "estimator", "weights"))
        return EstimatorCell(config, shape)
