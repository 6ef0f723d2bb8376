"""A cell that looks from the fingers: spheres along them as basis points that move with the hand.

The paper's grid of basis points tells the cell what the object looks like at its estimate, and leaves it to learn
where the fingers are. Here the closest points are taken from the fingers themselves: whether a finger touches, where,
how hard it is pushed there and how it moved are inputs. No part of the paper.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from tactile_kit.errors import EstimatorError
from tactile_kit.estimator.cell import Apply, EstimatorCell
from tactile_kit.estimator.config import EstimatorConfig
from tactile_kit.estimator.fingers import MEMORY, Fingers, fingers
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.estimator.step import moved
from tactile_kit.estimator.touch import INPUTS, touch
from tactile_kit.shape.moving import surface_vectors


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
        seen_at_pose = touch(own, at.x, vectors, seen)
        after = moved(own, (transition or self.transition)(seen_at_pose))
        return after._replace(latent=torch.cat([after.latent, seen.memory], dim=1))
