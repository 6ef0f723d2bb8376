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


def object_label(item: Object, two_lines: bool = False) -> str:
    """'8 cube', or the number above the name for narrow axes."""
    name = item.name.replace("_", " ")
    if not two_lines:
        return f"{item.id} {name}"
    if len(name) > 13:  # the longest name would run into its neighbours
        name = name[:6] + "…" + name[-6:]
    return f"{item.id}\n" + "\n".join(name.split(" "))
