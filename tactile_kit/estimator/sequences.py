"""Training data of the estimator: T steps of E environments, episodes starting anywhere inside."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from tactile_kit.errors import EstimatorError
from tactile_kit.estimator.state import EstimatorState


@dataclass(frozen=True)
class Sequences:
    """T steps of E environments. In each step the estimator turns its state before the action into the one after.

    z: ``(T, E, 144)`` rad, measured during the step; mesh: ``(T, E) int64``, the mesh given;
    started: ``(T, E) bool``, the step is the first of an episode: the state before is ``initial(R_before)``;
    x_before, x: ``(T, E, 3)`` m and R_before, R: ``(T, E, 3, 3)``, the true pose before and after the step;
    valid: ``(T, E) bool``, the step has measurements and an outcome. Only an episode's last step can lack them, where
    the physics failed; its other entries must be finite numbers but are not used;
    state: what the estimator held before the first step (used where ``started[0]`` is not set), without a
    graph;
    distances: ``(T, E, N_b)`` m, basis-point distances at the true pose before each step, where they have been computed
    already: every pass needs the same.
    """

    z: Tensor
    mesh: Tensor
    started: Tensor
    x_before: Tensor
    R_before: Tensor
    x: Tensor
    R: Tensor
    valid: Tensor
    state: EstimatorState
    distances: Tensor | None = None

    def __post_init__(self) -> None:
        if self.z.ndim != 3:
            raise EstimatorError(f"z has shape {tuple(self.z.shape)}, allowed: (T, E, 144)")
        lead = self.z.shape[:2]
        for name, (rest, _) in _ARRAYS.items():
            shape = tuple(getattr(self, name).shape)
            if shape != (*lead, *rest):
                raise EstimatorError(f"{name} has shape {shape}, allowed: {(*lead, *rest)}")
        if any(len(part) != lead[1] for part in self.state):
            raise EstimatorError(f"state holds {len(self.state.x)} environments, allowed: {lead[1]}")

    @property
    def steps(self) -> int:
        """T."""
        return self.z.shape[0]

    def __len__(self) -> int:
        return self.z.shape[1]

    def columns(self, index: Tensor | slice) -> Sequences:
        """The sequences of some environments."""
        parts = {name: getattr(self, name)[:, index] for name in _ARRAYS}
        distances = None if self.distances is None else self.distances[:, index]
        return Sequences(**parts, state=self.state.rows(index), distances=distances)

    def row(self, step: int) -> dict[str, Tensor]:
        """One step's arrays by name, ``(E, ...)``."""
        return {name: getattr(self, name)[step] for name in _ARRAYS}

    def starting(self, state: EstimatorState) -> Sequences:
        """The same steps after another ``state``."""
        return replace(self, state=state)

    def with_distances(self, distances: Tensor) -> Sequences:
        """The same steps with their basis-point distances ``(T E, N_b)`` m."""
        return replace(self, distances=distances.unflatten(0, self.z.shape[:2]))

    @staticmethod
    def joined(parts: list[Sequences]) -> Sequences:
        """Environments of several batches of equal length side by side."""
        arrays = {name: torch.cat([getattr(part, name) for part in parts], dim=1) for name in _ARRAYS}
        return Sequences(
            **arrays, state=EstimatorState(*map(torch.cat, zip(*(p.state for p in parts), strict=True)))
        )

    def tensors(self) -> dict[str, Tensor]:
        """Everything as named tensors, for saving."""
        state = {f"state.{name}": part for name, part in self.state._asdict().items()}
        return {name: getattr(self, name) for name in _ARRAYS} | state

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> Sequences:
        """Inverse of :meth:`tensors`."""
        state = EstimatorState(**{name: tensors[f"state.{name}"] for name in EstimatorState._fields})
        return cls(**{name: tensors[name] for name in _ARRAYS}, state=state)

    def of(self, num_envs: int, meshes: int) -> Sequences:
        """These, where they are of so many environments and meshes, and of the types they are recorded in.

        Raises EstimatorError.
        """
        for name, (_, dtype) in _ARRAYS.items():
            if (found := getattr(self, name).dtype) != dtype:
                raise EstimatorError(f"{name} is of {found}, allowed: {dtype}")
        if len(self) != num_envs:
            raise EstimatorError(f"{len(self)} environments, allowed: {num_envs}")
        if self.mesh.numel() and not 0 <= int(self.mesh.min()) <= int(self.mesh.max()) < meshes:
            raise EstimatorError(f"mesh {int(self.mesh.max())}, allowed: 0 to {meshes - 1}")
        return self


# beyond the first two axes, steps and environments
_ARRAYS: dict[str, tuple[tuple[int, ...], torch.dtype]] = {
    "z": ((144,), torch.float32),
    "mesh": ((), torch.int64),
    "started": ((), torch.bool),
    "x_before": ((3,), torch.float32),
    "R_before": ((3, 3), torch.float32),
    "x": ((3,), torch.float32),
    "R": ((3, 3), torch.float32),
    "valid": ((), torch.bool),
}
