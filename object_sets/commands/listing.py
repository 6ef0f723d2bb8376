"""``object-sets list``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro


@dataclass(frozen=True)
class List:
    """Show the authored sets and their objects: size, volume, convexity, number of convex parts and of faces."""

    name: Annotated[str, tyro.conf.Positional] = "all"
    """A set, or a directory made by `object-sets build`."""

    def run(self) -> int:
        from object_sets import load

        chosen = load(self.name)
        print(
            f"{'id':>3}  {'name':<22} {'extents (mm)':<20} {'cm^3':>7} {'convex':>6} {'parts':>5} {'faces':>5}"
        )
        for item in chosen:
            size = " x ".join(f"{1000 * side:.1f}" for side in item.extents)
            convex = "yes" if item.convex else "no"
            print(
                f"{item.id:>3}  {item.name:<22} {size:<20} {1e6 * item.volume:>7.1f} {convex:>6} "
                f"{len(item.parts):>5} {len(item.faces):>5}"
            )
        return 0
