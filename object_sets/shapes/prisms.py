"""Convex prisms along z: pentagon, hexagon, cylinder."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from object_sets.csg import chamfered_polyhedron, convex_hull, fitted
from object_sets.shapes.dimensions import CHAMFER, NOMINAL

SEGMENTS = 24  # of the cylinder: at most 0.3 mm off the circle, and few enough corners for a fast hull


def pentagon_prism() -> Manifold:
    """A pentagon, regular but for the 5 % that bring width and depth to the same extent."""
    return _regular_prism(5)


def hexagonal_prism() -> Manifold:
    """A hexagon, stretched by 15 % across its flats, which brings width and depth to the same extent."""
    return _regular_prism(6)


def cylinder() -> Manifold:
    """Diameter = height, rims chamfered; the polygon's corners lie on the circle."""
    radius, half = NOMINAL / 2.0, NOMINAL / 2.0
    rings = [
        (radius - CHAMFER, -half),
        (radius, CHAMFER - half),
        (radius, half - CHAMFER),
        (radius - CHAMFER, half),
    ]
    angles = 2.0 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    return convex_hull(np.vstack([np.column_stack([r * circle, np.full(SEGMENTS, z)]) for r, z in rings]))


def _regular_prism(sides: int) -> Manifold:
    angles = np.pi / 2.0 + 2.0 * np.pi * np.arange(sides) / sides
    polygon = np.column_stack([np.cos(angles), np.sin(angles)])
    polygon *= NOMINAL / np.ptp(polygon, axis=0)
    polygon -= (polygon.min(axis=0) + polygon.max(axis=0)) / 2.0
    corners = np.vstack(
        [np.column_stack([polygon, np.full(sides, z)]) for z in (-NOMINAL / 2.0, NOMINAL / 2.0)]
    )
    # The chamfers take about a millimetre off the outermost corners: fitted once more.
    return fitted(chamfered_polyhedron(corners, CHAMFER), NOMINAL)
