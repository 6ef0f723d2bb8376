"""Unions of two to four boxes, cylinders and ellipsoids, some with a box or cylinder cut out."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from object_sets.csg import box, ellipsoid, fitted

PIECES = (2, 4)
CUT = 0.5  # probability that something is cut out
SIZES = (0.3, 1.0)  # of a piece, relative to the first box's possible size
OFFSET = 0.35  # of a piece's centre
HULL = (0.35, 0.97)  # volume over the convex hull's: neither spidery nor convex
SEGMENTS = 24
QUARTERS = ((0.0, 0.0, 0.0), (90.0, 0.0, 0.0), (0.0, 90.0, 0.0))  # degrees: a cylinder along z, y or x


def draw(generator: np.random.Generator, extents: np.ndarray) -> Manifold:
    """One composition in one piece, with bounding box ``extents`` (3,) m."""
    while True:
        solid = _piece(generator)
        for _ in range(int(generator.integers(*PIECES))):
            solid = solid + _piece(generator)
        if generator.random() < CUT:
            solid = solid - _piece(generator, shrunk=0.6)
        if solid.is_empty() or len(solid.decompose()) != 1:
            continue
        solid = fitted(solid, extents)
        if HULL[0] <= solid.volume() / solid.hull().volume() <= HULL[1]:
            return solid


def _piece(generator: np.random.Generator, shrunk: float = 1.0) -> Manifold:
    """A box, cylinder or ellipsoid somewhere around the origin; ``shrunk`` ones are never ellipsoids."""
    kind = int(generator.integers(3 if shrunk == 1.0 else 2))
    sizes = shrunk * generator.uniform(*SIZES, 3)
    center = generator.uniform(-OFFSET, OFFSET, 3)
    turn = QUARTERS[int(generator.integers(3))]
    if kind == 0:
        return box(sizes, center)
    if kind == 1:
        rod = Manifold.cylinder(float(sizes[2]), float(sizes[0]) / 2.0, -1.0, SEGMENTS, True)
        return rod.rotate(turn).translate(tuple(center))
    return ellipsoid(sizes / 2.0, center)
