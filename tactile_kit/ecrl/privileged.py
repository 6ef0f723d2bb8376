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
from tactile_kit.rotations import to_6d
from tactile_kit.shape.moving import surface_vectors
from tactile_kit.task.observation import goal_term

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

    def __call__(self, rows: NDArray[np.int64] | slice = slice(None)) -> NDArray[np.float32]:
        """``(N, WIDTH)`` of the environments ``rows``, lengths in m, rotations in 6-D form."""
        state = self.env.state
        x, R, goal, body = (
            state.x[rows],
            state.R[rows],
            state.goal[rows],
            torch.as_tensor(state.variant[rows]),
        )
        place, turn = (torch.as_tensor(part, dtype=torch.float32) for part in (x, R))
        vectors = surface_vectors(
            self.env.meshes, place, turn, torch.from_numpy(spheres(self._q[rows])), body
        )
        clearance = torch.linalg.vector_norm(vectors, dim=-1) - RADII
        turned = R @ np.swapaxes(self._R[rows], 1, 2)
        parts = [goal_term(goal, R), x, to_6d(R), x - self._x[rows], to_6d(turned)]
        parts.append(clearance.numpy())
        return np.concatenate(parts, axis=1, dtype=np.float32)
