"""The paper's cell: encoded measurements, the shape encoding at the estimate, and the estimate itself."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from tactile_kit.estimator import so3
from tactile_kit.estimator.cell import MEASUREMENTS, Apply, EstimatorCell, mlp
from tactile_kit.estimator.config import EstimatorConfig
from tactile_kit.estimator.repeated import Repeated
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.estimator.step import LENGTH_SCALE, POSE, moved
from tactile_kit.hand.kinematics import JOINTS, MEAN_GRASP

SAMPLES = 6
# Joints move some 0.3 rad around the mean grasp; a control error of 0.2 rad saturates the torque.
JOINT_SCALE, ERROR_SCALE = 0.3, 0.1


class PaperCell(EstimatorCell):
    """Section II-D: f(z, l, V(x̂, R̂), x̂, R̂), with an encoder of its own for z (the website's 144 → 32)."""

    def __init__(self, config: EstimatorConfig, shape: Any) -> None:
        super().__init__(config, shape, config.features + shape.size + POSE)
        self.observation_size: int = shape.observation_size
        self.features: nn.Module | None = shape.features()
        self.encoder = mlp((MEASUREMENTS, *config.encoder_hidden, config.features))
        mean, scale = _measurement_scaling()
        self.register_buffer("z_mean", mean)
        self.register_buffer("z_scale", scale)
        self.register_buffer("input_scale", _input_scaling(config, shape))

    def look(self, z: Tensor, started: Tensor, state: EstimatorState) -> list[Tensor]:
        """Measurement features ``(B, 32)`` a step."""
        steps, count = z.shape[:2]
        encoder: Apply = self.encoder
        if torch.is_grad_enabled():
            encoder = Repeated(self.encoder, 1, steps * count, self.config.bfloat16)
        features = encoder((z.flatten(0, 1) - self.z_mean) / self.z_scale)
        # unbind: one gradient for all steps, where indexing would add up T full-sized ones
        return list(features.unflatten(0, (steps, count)).unbind(0))

    def step(
        self,
        state: EstimatorState,
        seen: Tensor,
        encoding: Any,
        mesh: Tensor,
        transition: Apply | None = None,
    ) -> EstimatorState:
        parts = [seen, state.latent]
        if self.observation_size:
            at = state.detach() if self.config.stop_gradient else state
            shape = encoding(at.x, at.R, mesh)
            parts.append(shape if self.features is None else self.features(shape / LENGTH_SCALE))
        parts += [state.x, so3.to_6d(state.R)]
        return moved(state, (transition or self.transition)(torch.cat(parts, dim=-1) * self.input_scale))


def _measurement_scaling() -> tuple[Tensor, Tensor]:
    grasp = torch.as_tensor(MEAN_GRASP, dtype=torch.float32)
    mean = torch.cat([grasp, torch.zeros(JOINTS)]).repeat(SAMPLES)
    scale = torch.tensor([JOINT_SCALE] * JOINTS + [ERROR_SCALE] * JOINTS).repeat(SAMPLES)
    return mean, scale


def _input_scaling(config: EstimatorConfig, shape: Any) -> Tensor:
    """Factors on the transition's inputs: lengths are divided by LENGTH_SCALE, the rest is of order one."""
    scale = torch.full((shape.size,), 1.0 if shape.size != shape.observation_size else 1.0 / LENGTH_SCALE)
    scale[shape.unitless] = 1.0
    pose = torch.tensor([1.0 / LENGTH_SCALE] * 3 + [1.0] * 6)
    return torch.cat([torch.ones(config.features + config.latent), scale, pose])
