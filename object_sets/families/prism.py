"""Prisms along z over a random polygon of 3 to 8 corners, convex or not, edges chamfered."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from object_sets.csg import chamfered_prism, fitted
from object_sets.shapes.dimensions import CHAMFER

CORNERS = (3, 8)
RADII = (0.3, 1.0)  # of the corners, relative; unequal ones make notches
SHORTEST = 4.0 * CHAMFER  # m, of an edge: two chamfers and as much left between them
ANGLES = (40.0, 320.0)  # degrees inside a corner
STRAIGHT = 10.0  # degrees from 180 below which a corner is none
FILLED = 0.35  # of the bounding rectangle


def draw(generator: np.random.Generator, extents: np.ndarray) -> Manifold:
    """One prism with bounding box ``extents`` (3,) m."""
    while True:
        profile = _polygon(generator, extents[:2])
        if _printable(profile, extents[:2]):
            # Chamfers take off a little of the outermost corners: fitted once more.
            return fitted(chamfered_prism(profile, float(extents[2]), CHAMFER), extents)


def _polygon(generator: np.random.Generator, sides: np.ndarray) -> np.ndarray:
    """(n, 2) m, counter-clockwise, star-shaped around the origin, with bounding box ``sides``."""
    count = int(generator.integers(CORNERS[0], CORNERS[1] + 1))
    angles = 2.0 * np.pi * (np.arange(count) + generator.uniform(-0.3, 0.3, count)) / count
    points = generator.uniform(*RADII, count)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    points = points * sides / np.ptp(points, axis=0)
    return points - (points.min(axis=0) + points.max(axis=0)) / 2.0


def _printable(points: np.ndarray, sides: np.ndarray) -> bool:
    """Whether edges are long enough, corners neither needles nor straight, and enough of the rectangle is filled."""
    ahead, back = np.roll(points, -1, axis=0) - points, np.roll(points, 1, axis=0) - points
    cross = ahead[:, 0] * back[:, 1] - ahead[:, 1] * back[:, 0]
    inside = np.degrees(np.arctan2(cross, (ahead * back).sum(axis=1))) % 360.0
    area = 0.5 * (points[:, 0] * np.roll(points[:, 1], -1) - points[:, 1] * np.roll(points[:, 0], -1)).sum()
    return bool(
        np.linalg.norm(ahead, axis=1).min() >= SHORTEST
        and ((inside > ANGLES[0]) & (inside < ANGLES[1]) & (abs(inside - 180.0) > STRAIGHT)).all()
        and area >= FILLED * sides.prod()
    )
