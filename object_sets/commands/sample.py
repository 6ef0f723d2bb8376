"""``object-sets sample``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from object_sets.commands.common import default_jobs, parse_extent, progress, summary


@dataclass(frozen=True)
class Sample:
    """Draw a set of random objects of one family. The same seed gives the same files, byte for byte."""

    family: Literal["prism", "superquadric", "csg"]
    """Prisms over random polygons; superellipsoids; unions and differences of boxes, cylinders and ellipsoids."""
    count: int = 8
    """Number of objects. A longer set begins with the shorter one."""
    seed: int = 0
    """Of everything that is drawn."""
    out: Path = Path("object-set")
    """Directory to write."""
    extent: str = "0.045:0.09"
    """Range of extents in metres, LOW:HIGH; each axis is drawn uniformly."""
    graspable: bool = False
    """Keep only objects that a grasp check holds; what fails is drawn again. tactile-kit brings a check."""
    grasp_check: str | None = None
    """Which grasp check, where several are installed."""
    coacd_threshold: float = 0.05
    """Concavity bound of the convex parts, 0.01 to 1; lower means more parts."""
    max_parts: int = 8
    """Bound on the number of convex parts."""
    timeout: float = 300.0
    """Seconds that the convex parts of one object may take."""
    memory: float = 4.0
    """GiB that a process working on one object may take."""
    mass: float | None = None
    """Mass of every object, kg; or --density."""
    density: float | None = None
    """Density of every object, kg/m^3."""
    jobs: int = field(default_factory=default_jobs)
    """Objects worked on at once. Default: one a core."""

    def run(self) -> int:
        """Draw, then name what could not be made."""
        from object_sets.errors import ObjectSetError
        from object_sets.sampling import grasp_check, sample

        if self.grasp_check is not None and not self.graspable:
            raise ObjectSetError(f"--grasp-check {self.grasp_check}: needs --graspable")
        extent = parse_extent(self.extent)
        assert extent is not None
        with progress("drawing") as report:
            path = sample(
                self.out,
                self.family,
                self.count,
                seed=self.seed,
                extent=extent,
                graspable=grasp_check(self.grasp_check) if self.graspable else None,
                coacd_threshold=self.coacd_threshold,
                max_parts=self.max_parts,
                timeout=self.timeout,
                memory=self.memory,
                mass=self.mass,
                density=self.density,
                jobs=self.jobs,
                progress=report,
            )
        return summary(path)
