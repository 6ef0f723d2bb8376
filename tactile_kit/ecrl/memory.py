"""Recorded steps: one roll-out being filled, and a few finished ones to train on."""

from __future__ import annotations

import torch
from torch import Tensor

from tactile_kit.errors import EstimatorError
from tactile_kit.estimator.sequences import Sequences
from tactile_kit.estimator.state import EstimatorState


class Memory:
    """Collects ``steps`` steps of E environments into ``Sequences``, and keeps the last ``kept`` of them.

    Attributes:
        recent: finished roll-outs, oldest first.
    """

    def __init__(self, steps: int, kept: int) -> None:
        self.steps, self.kept = steps, kept
        self.recent: list[Sequences] = []
        self._rows: list[dict[str, Tensor]] = []
        self._state: EstimatorState | None = None

    def add(self, state: EstimatorState, row: dict[str, Tensor]) -> bool:
        """Record one step: the estimator's state before it, and a row of ``Sequences``' arrays without T.

        Returns whether this step completed a roll-out.
        """
        if not self._rows:
            self._state = EstimatorState(*(part.clone() for part in state.detach()))
        self._rows.append(row)
        if len(self._rows) < self.steps:
            return False
        assert self._state is not None
        self.recent.append(Sequences(**self._stacked(), state=self._state))
        del self.recent[: -self.kept]
        self._rows = []
        return True

    def _stacked(self) -> dict[str, Tensor]:
        return {name: torch.stack([row[name] for row in self._rows]) for name in self._rows[0]}

    def tensors(self) -> dict[str, Tensor]:
        """Finished and unfinished roll-outs as named tensors: ``recent.<i>.<name>``, ``open.<name>``."""
        flat = {
            f"recent.{index}.{name}": value
            for index, sequences in enumerate(self.recent)
            for name, value in sequences.tensors().items()
        }
        if self._rows and self._state is not None:
            flat |= {f"open.{name}": value for name, value in self._stacked().items()}
            flat |= {f"open.state.{name}": value for name, value in self._state._asdict().items()}
        return flat

    def load_tensors(self, flat: dict[str, Tensor], num_envs: int, meshes: int) -> None:
        """Inverse of :meth:`tensors`.

        Raises EstimatorError unless they are of ``num_envs`` environments, ``meshes`` and as many steps as it records.
        """
        self.recent = []
        while part := _below(flat, f"recent.{len(self.recent)}."):
            self.recent.append(Sequences.from_tensors(part).of(num_envs, meshes))
        if any(sequences.steps != self.steps for sequences in self.recent):
            raise EstimatorError(f"a recording has other steps than the {self.steps} allowed")
        self._rows, self._state = [], None
        if part := _below(flat, "open."):
            begun = Sequences.from_tensors(part).of(num_envs, meshes)
            if begun.steps >= self.steps:
                raise EstimatorError(
                    f"a recording of {begun.steps} steps is open, allowed: fewer than {self.steps}"
                )
            self._state = begun.state
            self._rows = [begun.row(index) for index in range(begun.steps)]


def _below(flat: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in flat.items() if name.startswith(prefix)}
