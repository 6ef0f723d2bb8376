"""Shapes put together from simple solids: the emergency switch."""

from __future__ import annotations

from manifold3d import Manifold

from object_sets.csg import chamfered_prism, revolution
from object_sets.shapes.dimensions import CHAMFER, NOMINAL

BUTTON = 0.72  # diameter of the button over the width of the base; pictures give 0.70 to 0.75
SEGMENTS = 24


def emergency_switch() -> Manifold:
    """A square base and a coaxial cylindrical button, half the height each, chamfered."""
    half = NOMINAL / 2.0
    square = [(-half, -half), (half, -half), (half, half), (-half, half)]
    base = chamfered_prism(square, half, CHAMFER).translate((0.0, 0.0, -half / 2.0))
    radius = BUTTON * half
    button = revolution(
        [
            (0, -half / 2.0),
            (radius, -half / 2.0),
            (radius, half - CHAMFER),
            (radius - CHAMFER, half),
            (0, half),
        ],
        SEGMENTS,
    )
    return base + button
