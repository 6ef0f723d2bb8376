"""Which turns leave an object looking the same, and how far an estimate is off up to these.

Touch can't tell such poses apart; the paper's measures do. Turns are found on the mesh, not declared by its maker, so
that they are there for any object and size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tactile_kit.rotations import exp, geodesic, octahedral
from tactile_kit.shape.moving import POINTS, surface_vectors
from tactile_kit.shape.tables import MeshTable

Array = NDArray[np.float64]
TOLERANCE = 0.001  # m that a surface may stand out of itself, a turned one, and still be taken for the same
FOLDS = (2, 3, 4, 5, 6, 7, 8, 9, 10, 12)  # of the turns tried about each axis of the canonical frame
EDGE = 0.008  # m, longest edge of the triangles whose corners are compared
ROUND = 36  # an object that looks the same after so many equal turns about an axis does so after any
MOST = 60  # turns of the largest finite group there is, the icosahedron's; beyond it tolerances have added up


@dataclass(frozen=True)
class Symmetry:
    """The turns that leave an object as it is.

    rotations: ``(K, 3, 3)``, identity first; where there are ``axes`` these are beside any turn about them.
    axes: ``(A, 3)``, unit vectors; an object with two of them is a ball.
    """

    rotations: Array
    axes: Array

    @property
    def trivial(self) -> bool:
        """Whether every turn can be seen."""
        return len(self.rotations) == 1 and not len(self.axes)

    def error(self, believed: Array, true: Array) -> Array:
        """Angle (rad) from ``believed`` to the nearest of the orientations that look like ``true``; ``(..., 3, 3)``
        both, at most ``rotations.geodesic`` of them."""
        believed, true = np.asarray(believed, np.float64), np.asarray(true, np.float64)
        if len(self.axes) > 1:
            return np.zeros(believed.shape[:-2])
        turn = np.swapaxes(true, -1, -2) @ believed
        left = np.swapaxes(self.rotations, -1, -2) @ turn[..., None, :, :]
        if not len(self.axes):
            return geodesic(left, np.eye(3)).min(axis=-1)
        # Of a turn, what is left once the best turn about the axis is taken out: its swing.
        x, y, z, w = np.moveaxis(Rotation.from_matrix(left.reshape(-1, 3, 3)).as_quat(), -1, 0)
        about = np.stack([x, y, z], axis=-1) @ self.axes[0]
        swing = 2.0 * np.arctan2(
            np.sqrt(np.maximum(0.0, x * x + y * y + z * z - about**2)), np.hypot(w, about)
        )
        return swing.reshape(left.shape[:-2]).min(axis=-1)


def symmetry_of(thing: Any, tolerance: float = TOLERANCE) -> Symmetry:
    """The symmetry of an ``object_sets.Object``: turns about its centre of mass after which no point of its surface
    stands out of it by more than ``tolerance`` (m). Tried are turns about the axes of its canonical frame and the
    octahedral group's, and what these make together.
    """
    tried = [*octahedral()]
    for axis in np.eye(3):
        tried += [exp(axis * (2 * np.pi * k / n)) for n in FOLDS for k in range(1, n)]
    axes = [axis for axis in np.eye(3) if _same(thing, _around(axis), tolerance).all()]
    same = np.array(tried)[_same(thing, np.array(tried), tolerance)]
    if axes:  # turns about the axis are in ``error``; what is left is whether it can be turned upside down
        upside = [turn for turn in octahedral() if turn @ axes[0] @ axes[0] < -0.5]
        good = _same(thing, np.array(upside), tolerance)
        same = np.array([np.eye(3), *np.array(upside)[good][:1]])
    return Symmetry(_closed(same), np.array(axes).reshape(-1, 3))


def _around(axis: Array) -> Array:
    return np.array([exp(axis * (2 * np.pi * k / ROUND)) for k in range(ROUND)])


def _same(thing: Any, turns: Array, tolerance: float) -> NDArray[np.bool_]:
    """``(N,)`` for turns ``(N, 3, 3)``. Two solids of one volume are the same where nothing of one is outside the
    other."""
    import trimesh

    points, _ = trimesh.remesh.subdivide_to_size(thing.vertices, thing.faces, EDGE)
    points = np.concatenate([points, np.repeat(points[:1], -len(points) % POINTS, axis=0)])
    centre = thing.center_of_mass
    there = (points - centre) @ np.swapaxes(turns, 1, 2) + centre
    rows = torch.from_numpy(there.reshape(-1, POINTS, 3))
    table = MeshTable.from_meshes([(thing.vertices, thing.faces)])
    x, R = rows.new_zeros(len(rows), 3), torch.eye(3, dtype=rows.dtype).repeat(len(rows), 1, 1)
    out = surface_vectors(table, x, R, rows, torch.zeros(len(rows), dtype=torch.int64)).norm(dim=-1)
    return out.numpy().reshape(len(turns), -1).max(axis=1) < tolerance


def _closed(turns: Array) -> Array:
    """The group that the turns make, identity first."""
    group = [np.eye(3)]
    for turn in turns:
        _add(group, turn)
    before = 0
    while before < len(group) <= MOST:
        before = len(group)
        for first in group[:before]:
            for second in group[:before]:
                _add(group, first @ second)
    return np.array(group if len(group) <= MOST else [np.eye(3), *turns])


def _add(group: list[Array], turn: Array) -> None:
    if geodesic(np.array(group), turn).min() > 1e-6:
        group.append(turn)
