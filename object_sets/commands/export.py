"""``object-sets export``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class Export:
    """Write objects for a simulator: mesh, convex parts, mass, centre of mass and inertia. One folder an object."""

    objects: Annotated[str, tyro.conf.Positional]
    """A set, a comma list of sets, names and ids, or a directory made by `object-sets build` or `sample`."""
    format: Literal["urdf", "mjcf", "usd", "obj"]
    """URDF (PyBullet, Isaac, ROS), MJCF (MuJoCo), USD (Isaac Sim), or OBJ (geometry only)."""
    out: Path = Path("export")
    """Directory to write."""
    mass: float | None = None
    """Mass of every object, kg; or --density. Default: the object's own, and 0.05 kg where it is unknown."""
    density: float | None = None
    """Density of every object, kg/m^3."""

    def run(self) -> int:
        """Write the files and name them."""
        from object_sets import select
        from object_sets.exporters import export
        from object_sets.mass import DEFAULT_MASS

        chosen = select(self.objects)
        for file in export(chosen, self.out, self.format, mass=self.mass, density=self.density):
            print(file)
        unknown = [item.name for item in chosen if item.mass is None]
        if unknown and self.mass is None and self.density is None and self.format != "obj":
            print(
                f"{len(unknown)} of {len(chosen)} objects have no known mass: {DEFAULT_MASS} kg written; "
                "--mass or --density sets it"
            )
        return 0
