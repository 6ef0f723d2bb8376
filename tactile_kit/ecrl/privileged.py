"""What only the critic sees while a tactile agent is trained: the truth beside the belief (no part of the paper).

A policy that acts on estimates is judged by what happens to the object. From the belief alone the critic can't tell a
good action from a lucky estimate; with the truth beside it, it can. The agent never sees any of this.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from tactile_kit.estimator.fingers import RADII, spheres
from tactile_kit.shape.moving import surface_vectors
from tactile_kit.task.observation import goal_term
from tactile_kit.task.rotations import to_6d

if TYPE_CHECKING:
    from tactile_kit.task.vec_env import ReorientVecEnv

#: Terms after the agent's own: the rotation left, the pose, its change in the last step, the fingers' clearances.
TERMS = {"true_goal": 6, "true_pose": 9, "true_motion": 9, "true_clearance": len(RADII)}
WIDTH = sum(TERMS.values())


class Truth:
    """The private terms of the environments of ``env``."""

    def __init__(self, env: ReorientVecEnv) -> None:
        self.env = env
        self._x, self._R = env.state.x.copy(), env.state.R.copy()
        self._q = np.zeros_like(env.simulation.views["q"])

    def step(self, x_before: NDArray, R_before: NDArray) -> None:
        """Poses ``(E, 3)``, ``(E, 3, 3)`` before the step that ``env.state`` is the outcome of."""
        self._x[:], self._R[:] = x_before, R_before
        self._q[:] = self.env.simulation.views["q"]

    def begin(self, mask: NDArray[np.bool_]) -> None:
        """New episodes in ``mask (E,)``: nothing has moved yet."""
        state = self.env.state
        self._x[mask], self._R[mask] = state.x[mask], state.R[mask]
        self._q[mask] = self.env.simulation.views["q0"][mask]

    def __call__(self) -> NDArray[np.float32]:
        """``(E, WIDTH)``, lengths in m, rotations in 6-D form."""
        state = self.env.state
        x, R = (torch.as_tensor(part, dtype=torch.float32) for part in (state.x, state.R))
        points = torch.from_numpy(spheres(self._q))
        vectors = surface_vectors(self.env.meshes, x, R, points, torch.as_tensor(state.variant))
        clearance = torch.linalg.vector_norm(vectors, dim=-1) - RADII
        turned = state.R @ np.swapaxes(self._R, 1, 2)
        parts = [goal_term(state.goal, state.R), state.x, to_6d(state.R), state.x - self._x, to_6d(turned)]
        parts.append(clearance.numpy())
        return np.concatenate(parts, axis=1, dtype=np.float32)
