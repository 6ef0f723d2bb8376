"""Families of random solids, one file each: ``NAME.draw(generator, extents)`` gives one.

A family file draws everything from the generator it is given, so the same seed gives the same solid.
"""

from __future__ import annotations

FAMILIES = ("prism", "superquadric", "csg")
