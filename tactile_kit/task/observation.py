"""What the policy sees: named terms in a fixed order (paper, section II-C and its website)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from tactile_kit.rotations import to_6d
from tactile_kit.shape import Encoding
from tactile_kit.simulation.config import SAMPLES

JOINTS_SIZE = SAMPLES * 2 * 12


class Layout(Mapping[str, slice]):
    """Where each term stands in the flat observation: an ordered mapping from name to slice."""

    def __init__(self, sizes: Mapping[str, int]) -> None:
        self.sizes = dict(sizes)
        ends = np.cumsum(list(self.sizes.values())).tolist()
        starts = [0, *ends[:-1]]
        self._slices = {name: slice(a, b) for name, a, b in zip(self.sizes, starts, ends, strict=True)}

    def __getitem__(self, name: str) -> slice:
        return self._slices[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._slices)

    def __len__(self) -> int:
        return len(self._slices)

    def slice(self, name: str) -> slice:
        """Slice of the term ``name``."""
        return self._slices[name]

    @property
    def size(self) -> int:
        """Length of the flat observation."""
        return sum(self.sizes.values())


@dataclass
class Belief:
    """The object pose that the policy is told, with its uncertainty for tactile agents.

    ``x (E, 3)`` m, ``R (E, 3, 3)``, ``sigma (E, 2)`` or None.
    """

    x: NDArray[np.float32]
    R: NDArray[np.float32]
    sigma: NDArray[np.float32] | None = None

    def of(self, rows: NDArray[np.int64]) -> Belief:
        """What is believed in the environments ``rows (N,)``."""
        return Belief(self.x[rows], self.R[rows], None if self.sigma is None else self.sigma[rows])


def layout_of(encoding: Encoding, *, pose: bool, sigma: bool) -> Layout:
    """Layout of the observation for an encoding; ``pose`` counts for encodings that don't carry the pose themselves."""
    sizes = {"joints": JOINTS_SIZE, "goal": 6}
    if encoding.observation_size:
        sizes["shape"] = encoding.observation_size
    if pose and encoding.pose_beside:
        sizes["pose"] = 9
    if sigma:
        sizes["sigma"] = 2
    return Layout(sizes)


def goal_term(goal: NDArray, R: NDArray) -> NDArray:
    """6-D form of the rotation left to do, goal R^T, in the hand frame: ``(..., 3, 3)`` twice to ``(..., 6)``."""
    return to_6d(goal @ np.swapaxes(R, -1, -2))


class Observer:
    """Builds flat observations, batched over environments."""

    def __init__(self, layout: Layout, encoding: Encoding) -> None:
        self.layout, self.encoding = layout, encoding

    def __call__(self, z: NDArray, goal: NDArray, belief: Belief, given: NDArray) -> NDArray[np.float32]:
        """``z (E, 144)``, ``goal (E, 3, 3)``, ``given (E,)`` mesh numbers; returns ``(E, D) float32``."""
        out = np.empty((len(z), self.layout.size), np.float32)
        out[:, self.layout["joints"]] = z
        out[:, self.layout["goal"]] = goal_term(goal, belief.R)
        if "shape" in self.layout:
            with torch.no_grad():
                shape = self.encoding(
                    torch.as_tensor(belief.x, dtype=torch.float32),
                    torch.as_tensor(belief.R, dtype=torch.float32),
                    torch.as_tensor(given),
                )
            out[:, self.layout["shape"]] = shape.numpy()
        if "pose" in self.layout:
            out[:, self.layout["pose"]] = np.concatenate([belief.x, to_6d(belief.R)], axis=1)
        if "sigma" in self.layout:
            out[:, self.layout["sigma"]] = belief.sigma
        return out
