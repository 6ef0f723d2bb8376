"""Which way a solid lies in its own frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from object_sets.mass import mass_properties

if TYPE_CHECKING:
    from manifold3d import Manifold

SAME = 1e-3  # moments that differ by less, relative to the largest, leave the axes between them open


def aligned(solid: Manifold, alignment: str) -> Manifold:
    """The solid turned as ``alignment`` says (``importing.ImportConfig``); turned only, never mirrored."""
    from object_sets.csg import to_mesh

    if alignment == "none":
        return solid
    if alignment == "y-up":
        turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    else:
        # Unit-sized: coordinates are rounded to a grid that suits objects, not any unit a file may have.
        low, high = np.array(solid.bounding_box()).reshape(2, 3)
        factor = 1.0 / float((high - low).max())
        vertices, faces = to_mesh(solid.scale((factor, factor, factor)))
        turn = principal_axes(vertices, faces) if alignment == "inertia" else box_axes(vertices)
    return solid.transform(np.column_stack([turn, np.zeros(3)]))


def principal_axes(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(3, 3) rotation that brings the principal axes of the solid onto x, y, z, the smallest moment on x.

    Where moments are equal (a cube, a cylinder's cross-section) the axes of the file stay as near as possible.
    """
    moments, axes = np.linalg.eigh(mass_properties(vertices, faces).inertia)
    columns: list[np.ndarray] = []
    start = 0
    for end in range(1, 4):
        if end == 3 or moments[end] - moments[end - 1] > SAME * moments[2]:
            columns += _nearest_basis(axes[:, start:end])
            start = end
    return _rotation(np.array(columns))


def box_axes(vertices: np.ndarray) -> np.ndarray:
    """(3, 3) rotation that brings the sides of the smallest box around (V, 3) points onto x, y, z, the longest on x.

    The box that stands as the file does is kept unless another is smaller by more than a thousandth.
    """
    import trimesh

    to_box, sides = trimesh.bounds.oriented_bounds(vertices, ordered=False)
    if np.prod(sides) > (1.0 - SAME) * np.prod(np.ptp(vertices, axis=0)):
        to_box, sides = np.eye(4), np.ptp(vertices, axis=0)
    order = np.argsort(-np.round(sides / sides.max(), 6), kind="stable")
    return _rotation(to_box[:3, :3][order])


def _nearest_basis(space: np.ndarray) -> list[np.ndarray]:
    """An orthonormal basis of the columns' span (3, k) from the coordinate axes that lie nearest to it."""
    projector = space @ space.T
    basis: list[np.ndarray] = []
    for index in np.argsort(-np.round(np.diag(projector), 9), kind="stable"):
        vector = projector[index].copy()
        for other in basis:
            vector -= other * (other @ vector)
        if np.linalg.norm(vector) > 1e-6 and len(basis) < space.shape[1]:
            basis.append(vector / np.linalg.norm(vector))
    return basis


def _rotation(rows: np.ndarray) -> np.ndarray:
    """Rows as a proper rotation: x and y turned to point along the file's axes they lie nearest to, z follows."""
    rows = rows.copy()
    for row in rows[:2]:
        row *= np.sign(row[np.argmax(np.abs(np.round(row, 9)))]) or 1.0
    rows[2] = np.cross(rows[0], rows[1])
    return rows
