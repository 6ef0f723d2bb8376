"""Convex polyhedra: cube, cuboid, the cube with a corner cut off, the rhombicuboctahedron."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
from manifold3d import Manifold

from object_sets.csg import chamfered_polyhedron, convex_hull
from object_sets.shapes.dimensions import CHAMFER, NOMINAL

CUBOID = (0.08, 0.08, 0.05)  # the lab's, m
CUT = 0.65  # of the cube's edges, removed at one corner


def cube() -> Manifold:
    """6.75 cm, chamfered; unchanged by the 24 rotations of the goals."""
    return chamfered_polyhedron(_corners((NOMINAL,) * 3), CHAMFER)


def cuboid() -> Manifold:
    """8 x 8 x 5 cm, chamfered."""
    return chamfered_polyhedron(_corners(CUBOID), CHAMFER)


def cut_cube() -> Manifold:
    """A cube less one large corner, cut through three edges."""
    corners = _corners((NOMINAL,) * 3)
    kept = corners[corners.sum(axis=1) < NOMINAL]  # all but (+, +, +)
    half, end = NOMINAL / 2.0, NOMINAL * (0.5 - CUT)
    return chamfered_polyhedron(np.vstack([kept, list(permutations((half, half, end)))[:6]]), CHAMFER)


def rhombicuboctahedron() -> Manifold:
    """26 faces: 18 squares, 8 triangles. No chamfers: at its 135 and 145 degree edges there is nothing to break."""
    inner = 1.0 / (1.0 + np.sqrt(2.0))
    signs = np.array(list(product((-1, 1), repeat=3)))
    corners = np.vstack([signs * np.array(p) for p in sorted(set(permutations((inner, inner, 1.0))))])
    return convex_hull(corners * NOMINAL / 2.0)


def _corners(extents: tuple[float, ...]) -> np.ndarray:
    return np.array(list(product((-0.5, 0.5), repeat=3))) * np.array(extents)
