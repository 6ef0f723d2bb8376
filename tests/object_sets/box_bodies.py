"""Small mesh files made of boxes: in any order, inside out, each body with indices of its own or all of one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh

CM = 0.01


class Box(NamedTuple):
    """A box on a grid of centimetres, perhaps inside out."""

    low: tuple[int, int, int]
    high: tuple[int, int, int]
    outward: bool = True

    def mesh(self) -> trimesh.Trimesh:
        mesh = trimesh.creation.box(bounds=np.array([self.low, self.high]) * CM)
        if not self.outward:
            mesh.invert()
        return mesh


def cube(low: int, high: int, outward: bool = True) -> Box:
    return Box((low,) * 3, (high,) * 3, outward)


def inverted(boxes: Sequence[Box]) -> list[Box]:
    return [box._replace(outward=not box.outward) for box in boxes]


def write(path: Path, boxes: Sequence[Box], seed: int | None = None) -> Path:
    """OBJ: indices of its own for each body. STL: no indices at all. With a seed, faces and corners are shuffled."""
    meshes = [box.mesh() for box in boxes]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    faces = np.concatenate([mesh.faces + 8 * number for number, mesh in enumerate(meshes)])
    if seed is not None:
        generator = np.random.default_rng(seed)
        faces = generator.permutation(faces)
        faces = faces[
            np.arange(len(faces))[:, None], (np.arange(3) + generator.integers(3, size=(len(faces), 1))) % 3
        ]
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    return path
