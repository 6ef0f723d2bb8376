"""The 16 authored shapes, one file a family, and the table of what they are.

Sources: section 4 of the paper names and draws them; where it leaves a shape open, the reading is ours and says so in
``source``. Objects 13-15 of the paper come from another work and are not public: ours are stand-ins that share their
character (small features, high curvature), not their shape.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from object_sets.shapes import apple, compounds, figures, polyhedra, prisms, profiles

if TYPE_CHECKING:
    from manifold3d import Manifold

LICENCE = "MIT"


@dataclass(frozen=True)
class Shape:
    """One authored shape: how it is made and what it is.

    ``max_parts`` bounds the number of convex parts (-1: none), ``hull_vertices`` the corners of each: few parts with
    few corners make a fast simulation.
    """

    id: int
    name: str
    make: Callable[[], Manifold]  # canonical pose, m
    source: str
    mass: float | None = None  # kg
    max_parts: int = -1
    hull_vertices: int = 32


_PAPER = "authored after the paper's object set; 2 mm chamfers as on the printed objects"
_OPEN = "the paper does not name this shape, the reading is ours; 2 mm chamfers"
_STAND_IN = "authored stand-in: the paper's object is not public"

SHAPES: tuple[Shape, ...] = (
    Shape(0, "l_shape", profiles.l_shape, _PAPER, max_parts=2),
    Shape(1, "cut_cube", polyhedra.cut_cube, _OPEN),
    Shape(2, "pentagon_prism", prisms.pentagon_prism, _PAPER),
    Shape(3, "cylinder", prisms.cylinder, _PAPER),
    Shape(4, "hexagonal_prism", prisms.hexagonal_prism, _OPEN),
    Shape(
        5,
        "rhombicuboctahedron",
        polyhedra.rhombicuboctahedron,
        "authored after the paper's 26-sided 'sphere'",
    ),
    Shape(6, "h_profile", profiles.h_profile, _PAPER, max_parts=3),
    Shape(7, "plus_prism", profiles.plus_prism, _OPEN, max_parts=3),
    Shape(8, "cube", polyhedra.cube, _PAPER),
    Shape(9, "cuboid", polyhedra.cuboid, _PAPER),
    Shape(10, "t_shape", profiles.t_shape, _PAPER, max_parts=2),
    Shape(11, "emergency_switch", compounds.emergency_switch, _PAPER, max_parts=2, hull_vertices=48),
    Shape(
        12, "apple", apple.apple, "authored with the YCB apple's extents and mass, not its scan", mass=0.068
    ),
    Shape(13, "elephant", figures.elephant, _STAND_IN, max_parts=12, hull_vertices=40),
    Shape(14, "amphora", figures.amphora, _STAND_IN, max_parts=10, hull_vertices=40),
    Shape(15, "gear", figures.gear, _STAND_IN, max_parts=13, hull_vertices=40),
)
