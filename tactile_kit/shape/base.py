"""What every shape encoding is: a function S(x, R, M) of object pose and canonical mesh (paper eq. 1)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import torch

from tactile_kit.shape.tables import MeshTable


class Encoding(ABC):
    """Base of the encodings; a new one is one file and one line in ``registry.py``, or an entry point (see there).

    Class attributes: ``name`` in the registry and ``label`` in figures; ``size`` features the network sees;
    ``observation_size`` numbers the observation carries (= size unless a learned layer, ``features()``, stands
    between). What others ask of an encoding, they ask here: its name is read by nobody.
    """

    name: ClassVar[str]
    label: ClassVar[str]
    size: ClassVar[int]
    observation_size: ClassVar[int]
    tells_shape: ClassVar[bool] = True  # whether the mesh has a say in it
    pose_beside: ClassVar[bool] = True  # whether the observation has the pose as a term of its own beside it
    unitless: ClassVar[slice] = slice(0, 0)  # those of its numbers that are no lengths in metres
    per_basis_point: ClassVar[int] = (
        0  # 3 where it is the vectors of basis_points(), 1 where their lengths, else 0
    )

    def __init__(self, meshes: MeshTable) -> None:
        self.meshes = meshes

    @abstractmethod
    def __call__(self, x: torch.Tensor, R: torch.Tensor, mesh: torch.Tensor) -> torch.Tensor:
        """Encode a batch of poses.

        x (B, 3) float32 or float64, metres, and R (B, 3, 3), same dtype: object pose in the hand frame; mesh (B,)
        int64, index into ``meshes``. Returns (B, observation_size) of x's dtype, differentiable in x and R.
        Raises PoseError for wrong shapes, dtypes or values.
        """

    @staticmethod
    def features() -> torch.nn.Module | None:
        """A new learned layer (B, observation_size) -> (B, size), or None where the network reads the observation."""
        return None
