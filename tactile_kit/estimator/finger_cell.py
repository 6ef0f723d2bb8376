"""A cell that looks from the fingers: spheres along them as basis points that move with the hand.

The paper's grid of basis points tells the cell what the object looks like at its estimate, and leaves it to learn
where the fingers are. Here the closest points are taken from the fingers themselves: whether a finger touches, where,
how hard it is pushed there and how it moved are inputs. No part of the paper.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from tactile_kit.estimator import so3
from tactile_kit.estimator.cell import LENGTH_SCALE, POSE, Apply, EstimatorCell
from tactile_kit.estimator.config import EstimatorConfig
from tactile_kit.estimator.errors import EstimatorError
from tactile_kit.estimator.fingers import ANGLES, FINGERS, MEMORY, PAD, RADII, SPHERES, Fingers, fingers
from tactile_kit.estimator.fits import FIT_SCALE, fits
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.shape.moving import surface_vectors

# m, but for the last: what vectors to the surface, clearances, levers, pushes, moves and lever times move come to
VECTOR, CLEARANCE, LEVER, PUSH, MOVE, SWEEP = 0.02, 0.006, 0.05, 0.015, 0.005, 2e-4
INPUTS = POSE + ANGLES + FINGERS * (4 * SPHERES + 4 * 3 + 2) + len(FIT_SCALE)


class FingerCell(EstimatorCell):
    """f(fingers, l, closest points from the fingers at (x̂, R̂), x̂, R̂).

    Behind the latent state it keeps the last step's measurements, which need no learning.

    Raises:
        EstimatorError: ``shape`` is the encoding of an agent that is not told the mesh, which this cell looks at.
    """

    def __init__(self, config: EstimatorConfig, shape: Any) -> None:
        if not shape.tells_shape:
            raise EstimatorError(
                f"estimator.cell 'fingers' looks at the mesh, encoding {shape.name!r} tells none; allowed: 'paper'"
            )
        super().__init__(config, shape, INPUTS)
        self.register_buffer("radii", RADII, persistent=False)
        self.register_buffer("fit_scale", FIT_SCALE, persistent=False)

    def initial(self, R0: Tensor) -> EstimatorState:
        state = super().initial(R0)
        return state._replace(latent=torch.cat([state.latent, torch.zeros(len(R0), MEMORY)], dim=1))

    def look(self, z: Tensor, started: Tensor, state: EstimatorState) -> list[Fingers]:
        """The fingers of every step."""
        return fingers(z, started, state.latent[:, self.config.latent :]).steps()

    def step(
        self,
        state: EstimatorState,
        seen: Fingers,
        encoding: Any,
        mesh: Tensor,
        transition: Apply | None = None,
    ) -> EstimatorState:
        n = self.config.latent
        own = state._replace(latent=state.latent[:, :n])
        at = own.detach() if self.config.stop_gradient else own
        vectors = surface_vectors(encoding.meshes, at.x, at.R, seen.points, mesh)
        parts = [own.latent, seen.joints, own.x / LENGTH_SCALE, so3.to_6d(own.R)]
        parts += self._touch(at, seen, vectors)
        after = self.moved(own, (transition or self.transition)(torch.cat(parts, dim=-1)))
        return after._replace(latent=torch.cat([after.latent, seen.memory], dim=1))

    def _touch(self, state: EstimatorState, seen: Fingers, vectors: Tensor) -> list[Tensor]:
        """What the fingers feel of an object at the estimate, each ``(B, ...)`` of order one."""
        distance = (vectors.square().sum(-1) + 1e-10).sqrt()
        towards = (vectors / distance[..., None]).unflatten(1, (FINGERS, SPHERES))[:, :, PAD]
        lever = seen.points.unflatten(1, (FINGERS, SPHERES))[:, :, PAD] - state.x[:, None]
        clearance = ((distance - self.radii) / CLEARANCE).clamp(-3.0, 6.0)
        told = [
            vectors.flatten(1) / VECTOR,
            lever.flatten(1) / LEVER,
            seen.push.flatten(1) / PUSH,
            seen.move.flatten(1) / MOVE,
            torch.linalg.cross(lever, seen.move).flatten(1) / SWEEP,
            (seen.push * towards).sum(-1) / PUSH,
            (seen.move * towards).sum(-1) / MOVE,
        ]
        hints = fits(seen.points, vectors, state.x, seen.push, seen.move) * self.fit_scale
        return [*told, clearance, hints]
