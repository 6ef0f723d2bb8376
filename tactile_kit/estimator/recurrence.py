"""The cell over a sequence, with the states before and after every step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tactile_kit.estimator.cell import EstimatorCell
from tactile_kit.estimator.repeated import Repeated
from tactile_kit.estimator.sequences import Sequences
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.shape import MeshTable


@dataclass(frozen=True)
class Unrolled:
    """States before and after each update, parts ``(T, E, ...)``; shape: the encoding before, or None if not kept."""

    before: EstimatorState
    after: EstimatorState
    shape: Tensor | None


class _Recorded:
    """An encoding that keeps what it gave."""

    def __init__(self, encoding: Any) -> None:
        self.encoding = encoding
        self.given: list[Tensor] = []

    @property
    def meshes(self) -> MeshTable:
        return self.encoding.meshes

    def __call__(self, x: Tensor, R: Tensor, mesh: Tensor) -> Tensor:
        self.given.append(self.encoding(x, R, mesh))
        return self.given[-1]


def unroll(cell: EstimatorCell, sequences: Sequences, encoding: Any) -> Unrolled:
    """Run the cell over all steps; an episode that starts inside begins at ``initial`` with no past."""
    state, before, after, recorded = sequences.state.detach(), [], [], _Recorded(encoding)
    transition = Repeated(cell.transition, sequences.steps, len(sequences), cell.config.bfloat16)
    seen = cell.look(sequences.z, sequences.started, state)
    restarts = sequences.started.any(dim=1).tolist()
    for t in range(sequences.steps):
        if restarts[t]:
            state = state.replaced(sequences.started[t], cell.initial(sequences.R_before[t]))
        before.append(state)
        state = cell.step(state, seen[t], recorded, sequences.mesh[t], transition)
        after.append(state)
    stack = [EstimatorState(*map(torch.stack, zip(*states, strict=True))) for states in (before, after)]
    return Unrolled(stack[0], stack[1], torch.stack(recorded.given) if recorded.given else None)
