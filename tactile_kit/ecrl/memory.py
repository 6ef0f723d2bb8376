"""Recorded steps: one roll-out being filled, and a few finished ones to train on."""

from __future__ import annotations

import torch
from torch import Tensor

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

    def load_tensors(self, flat: dict[str, Tensor]) -> None:
        """Inverse of :meth:`tensors`."""
        self.recent = []
        while part := _below(flat, f"recent.{len(self.recent)}."):
            self.recent.append(Sequences.from_tensors(part))
        self._rows, self._state = [], None
        if part := _below(flat, "open."):
            self._state = EstimatorState(
                **{name: part.pop(f"state.{name}") for name in EstimatorState._fields}
            )
            count = len(next(iter(part.values())))
            self._rows = [{name: value[index] for name, value in part.items()} for index in range(count)]


def _below(flat: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in flat.items() if name.startswith(prefix)}
