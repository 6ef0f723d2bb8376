"""An apple with the extents of the YCB apple (75.4 x 74.9 x 71.9 mm, 68 g).

The dimples at stem and calyx are left out: no fingertip (radius 14 mm) fits in, and a convex body is the same for the
simulation, the shape encoding and the eye.
"""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from object_sets.csg import convex_hull, fitted

EXTENTS = (0.0754, 0.0749, 0.0719)  # m
CORNERS = 96


def apple() -> Manifold:
    """Broad shoulders above, narrower below, slightly five-lobed; corners spread evenly (Fibonacci sphere)."""
    index = np.arange(CORNERS)
    z = 1.0 - (2.0 * index + 1.0) / CORNERS
    azimuth = index * np.pi * (3.0 - np.sqrt(5.0))
    radius = np.sqrt(1.0 - z**2) * (1.0 + 0.13 * z) * (1.0 + 0.015 * np.cos(5.0 * azimuth) * (1.0 - z) / 2.0)
    height = z - 0.10 * np.sign(z) * z**2  # flattened ends
    points = np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height])
    return fitted(convex_hull(points), EXTENTS)
