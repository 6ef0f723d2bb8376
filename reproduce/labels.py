"""How objects are named on axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from object_sets import Object


def paper_objects() -> Sequence[Object]:
    """Objects 0-12, in order."""
    import object_sets

    return list(object_sets.load("paper"))


def complex_objects() -> Sequence[Object]:
    """Objects 13-15, in order."""
    import object_sets

    return list(object_sets.load("complex"))


SHORT = {  # for axes; the full names are in the object sets
    "l_shape": "L",
    "pentagon_prism": "pentagon",
    "hexagonal_prism": "hexagon",
    "rhombicuboctahedron": "26 sides",
    "h_profile": "H",
    "plus_prism": "plus",
    "t_shape": "T",
    "emergency_switch": "switch",
}


def object_label(item: Object, two_lines: bool = False) -> str:
    """'8 cube', or the number above the name for narrow axes."""
    name = SHORT.get(item.name, item.name.replace("_", " "))
    return f"{item.id}\n{name}" if two_lines else f"{item.id} {name}"
