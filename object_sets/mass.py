"""Exact mass properties of the homogeneous solid inside a closed triangle mesh (divergence theorem)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

DEFAULT_MASS = 0.05  # kg, of objects whose mass is unknown: the paper's objects

# Moments of the reference tetrahedron (0, a, b, c): integral of x_i x_j = det/120 * sum over corners, plus the square
# of their sum, as in any text on polyhedral mass properties.


class MassProperties(NamedTuple):
    """Of one closed mesh, as the homogeneous solid it bounds."""

    volume: float  # m^3, positive when the faces point outward
    center_of_mass: np.ndarray  # (3,) float64, m, frame of the vertices
    inertia: (
        np.ndarray
    )  # (3, 3) float64, kg m^2 for a mass of 1 kg, about the centre of mass, axes of the vertices


def signed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """m^3 inside a closed mesh, vertices (V, 3) m and faces (F, 3); positive where they point outward.

    Relative to a corner of the mesh: far from the origin the plain sum would cancel.
    """
    a, b, c = (vertices - vertices[faces[0, 0]])[faces].transpose(1, 0, 2)
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)


def mass_properties(vertices: np.ndarray, faces: np.ndarray) -> MassProperties:
    """Volume, centre of mass and inertia tensor, exact but for rounding.

    Args:
        vertices: (V, 3) float, m.
        faces: (F, 3) int, closed and oriented outward.

    Raises:
        ValueError: the mesh encloses no volume (within rounding), so the properties are undefined.
    """
    corners = np.asarray(vertices, dtype=np.float64)[np.asarray(faces)]  # (F, 3 corners, 3)
    origin = corners.reshape(-1, 3).mean(axis=0)  # near the solid: less cancellation
    corners = corners - origin
    determinants = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    volume = determinants.sum() / 6.0
    reach = np.abs(corners).max(initial=0.0)
    if abs(volume) <= 1e-12 * reach**3 or not np.isfinite(volume):
        raise ValueError(f"the mesh encloses a volume of {volume:g} m^3; mass properties need a closed solid")
    sums = corners.sum(axis=1)
    center = (determinants[:, None] * sums).sum(axis=0) / (24.0 * volume)
    second = np.einsum("f,fki,fkj->ij", determinants, corners, corners)
    second = (second + np.einsum("f,fi,fj->ij", determinants, sums, sums)) / (120.0 * volume)
    second -= np.outer(center, center)  # parallel axes: covariance of the solid
    inertia = np.trace(second) * np.eye(3) - second
    return MassProperties(float(volume), center + origin, (inertia + inertia.T) / 2.0)
