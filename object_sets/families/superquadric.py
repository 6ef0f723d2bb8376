"""Superellipsoids (Barr 1981): two exponents from nearly a box (0.2) over ball (1) and octahedron (2) to pinched."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from object_sets.csg import fitted, to_manifold

EXPONENTS = (0.2, 2.4)
AROUND, ALONG = 20, 10  # corners around the z axis and from pole to pole


def draw(generator: np.random.Generator, extents: np.ndarray) -> Manifold:
    """One superellipsoid with bounding box ``extents`` (3,) m."""
    return superellipsoid(generator.uniform(*EXPONENTS, 2), extents)


def superellipsoid(exponents: np.ndarray, extents: np.ndarray) -> Manifold:
    """The superellipsoid with ``exponents`` (2,), first from pole to pole, then around z."""
    polar = np.linspace(-np.pi / 2.0, np.pi / 2.0, ALONG + 1)[1:-1]
    around = 2.0 * np.pi * np.arange(AROUND) / AROUND
    ring = np.column_stack([_power(np.cos(around), exponents[1]), _power(np.sin(around), exponents[1])])
    radius, height = _power(np.cos(polar), exponents[0]), _power(np.sin(polar), exponents[0])
    rings = [np.column_stack([r * ring, np.full(AROUND, z)]) for r, z in zip(radius, height, strict=True)]
    vertices = np.vstack([*rings, [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0)]])
    south, north = len(vertices) - 2, len(vertices) - 1
    here = np.arange(AROUND)
    there = (here + 1) % AROUND
    faces = [np.column_stack([there, here, np.full(AROUND, south)])]
    for level in range(len(rings) - 1):
        low, high = AROUND * level, AROUND * (level + 1)
        faces.append(np.column_stack([low + here, low + there, high + there]))
        faces.append(np.column_stack([low + here, high + there, high + here]))
    last = AROUND * (len(rings) - 1)
    faces.append(np.column_stack([last + here, last + there, np.full(AROUND, north)]))
    return fitted(to_manifold(vertices, np.concatenate(faces)), extents)


def _power(values: np.ndarray, exponent: float) -> np.ndarray:
    """Signed power; zeros of sine and cosine are exact."""
    values = np.where(np.abs(values) < 1e-12, 0.0, values)
    return np.sign(values) * np.abs(values) ** exponent
