"""Stand-ins for the paper's complex objects 13-15: small features and high curvature. Written in units of 1 cm."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from manifold3d import Manifold

from object_sets.csg import box, ellipsoid, extrusion, fitted, limb, revolution, union


def elephant() -> Manifold:
    """An animal: body, head, large ears, a raised trunk, four legs, a tail."""
    trunk = [(3.3, 0, 0.9), (4.2, 0, -0.1), (4.9, 0, 0.1), (5.2, 0, 0.9)]
    legs = [limb((x, y, -0.5), (x, 1.15 * y, -2.8), (0.8, 0.7)) for x in (-1.8, 1.4) for y in (-1.05, 1.05)]
    solid = union(
        [
            ellipsoid((2.9, 2.0, 1.9), (-0.3, 0, 0.2)),
            ellipsoid((1.5, 1.35, 1.5), (2.7, 0, 1.5)),
            *[ellipsoid((0.45, 1.25, 1.4), (2.1, y, 1.9), 16) for y in (-1.9, 1.9)],
            *[limb(a, b, (0.62 - 0.06 * i, 0.56 - 0.06 * i)) for i, (a, b) in enumerate(pairwise(trunk))],
            *legs,
            limb((-2.9, 0, 0.8), (-3.7, 0, -0.4), (0.35, 0.28), 10),
        ]
    )
    return fitted(solid, (0.085, 0.058, 0.065))


def amphora() -> Manifold:
    """A vase, solid inside, with a foot, a neck, a lip and two handles."""
    outline = [(1.5, -3.6), (1.6, -3.2), (0.9, -2.7), (1.6, -1.8), (2.2, -0.7), (2.3, 0.2), (1.8, 1.2), (1.0, 1.8),
               (0.85, 2.7), (1.4, 3.2), (1.3, 3.6)]  # fmt: skip
    body = revolution([(0, -3.6), *outline, (0, 3.6)], 20)
    handle = [(0.8, 0, 2.6), (2.2, 0, 2.9), (2.9, 0, 2.0), (2.0, 0, 0.6)]
    handles = [
        limb((side * ax, ay, az), (side * bx, by, bz), (0.42, 0.42), 10)
        for side in (-1, 1)
        for (ax, ay, az), (bx, by, bz) in pairwise(handle)
    ]
    return fitted(union([body, *handles]), (0.0675, 0.0475, 0.075))


def gear(teeth: int = 8) -> Manifold:
    """A spur gear with a round hub on one side and a square shaft on the other."""
    root, tip = 2.5, 3.6
    step = 2.0 * np.pi / teeth
    offsets, radii = np.array([-0.27, -0.15, 0.15, 0.27]) * step, np.array([root, tip, tip, root])
    angles = (np.arange(teeth)[:, None] * step + offsets).ravel()
    profile = np.tile(radii, teeth)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    hub = revolution([(0, 0), (1.6, 0), (1.6, 2.6), (1.3, 2.9), (0, 2.9)], 16)
    return fitted(
        union([extrusion(profile, 2.0), hub, box((1.6, 1.6, 2.0), (0, 0, -1.9))]), (0.07, 0.07, 0.055)
    )
