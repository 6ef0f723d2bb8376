"""Non-convex profiles extruded along z by 6.75 cm: L, H, plus, T. Profiles are written in units of their width."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from object_sets.csg import chamfered_prism
from object_sets.shapes.dimensions import CHAMFER, NOMINAL


def l_shape() -> Manifold:
    """A cube less one quarter over its full length."""
    return _extruded([(0, 0), (1, 0), (1, 0.5), (0.5, 0.5), (0.5, 1), (0, 1)])


def h_profile() -> Manifold:
    """Two flanges and a web, each a third of the width thick."""
    t, u = 1.0 / 3.0, 2.0 / 3.0
    return _extruded(
        [(0, 0), (t, 0), (t, t), (u, t), (u, 0), (1, 0), (1, 1), (u, 1), (u, u), (t, u), (t, 1), (0, 1)]
    )


def plus_prism() -> Manifold:
    """A cross with arms 0.4 of its width wide."""
    s, t = 0.3, 0.7
    return _extruded(
        [(s, 0), (t, 0), (t, s), (1, s), (1, t), (t, t), (t, 1), (s, 1), (s, t), (0, t), (0, s), (s, s)]
    )


def t_shape() -> Manifold:
    """A bar on a stem, both 0.4 of the width thick."""
    s, t, top = 0.3, 0.7, 0.6
    return _extruded([(s, 0), (t, 0), (t, top), (1, top), (1, 1), (0, 1), (0, top), (s, top)])


def _extruded(profile: list[tuple[float, float]]) -> Manifold:
    return chamfered_prism((np.array(profile) - 0.5) * NOMINAL, NOMINAL, CHAMFER)
