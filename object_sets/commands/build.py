"""``object-sets build``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from object_sets.commands.common import default_jobs, parse_extent, progress, summary

SetName = Literal["geometric8", "ood", "complex", "paper", "all"]


@dataclass(frozen=True)
class Build:
    """Build a set: authored shapes or a folder of meshes in, npz files and a manifest out.

    A mesh that can't be used never stops the others; it is named at the end, and the exit code is 1.
    """

    set_name: Annotated[SetName | None, tyro.conf.Positional] = None
    """An authored set; or give --meshes."""
    meshes: Path | None = None
    """Folder of STL, OBJ, PLY, GLB/GLTF, OFF or 3MF files."""
    recursive: bool = False
    """Look into the folders of --meshes too."""
    out: Path = Path("object-set")
    """Directory to write."""
    extent: str | None = None
    """Range of extents in metres, LOW:HIGH, for example 0.045:0.09. Without it sizes stay."""
    scales: int = 0
    """Prepared sizes an object, each axis drawn uniformly from --extent."""
    center: Literal["bounding-box", "mass", "origin"] = "bounding-box"
    """What becomes a mesh's origin: middle of the bounding box, centre of mass, or the file's own."""
    align: Literal["none", "y-up", "inertia", "box"] = "none"
    """How a mesh is turned: not; its y becomes z; principal axes, or the smallest box, onto x, y, z, longest first."""
    max_faces: int = 4000
    """Denser meshes are simplified, the surface moving by at most 1 % of the size."""
    units: Literal["m", "cm", "mm", "inch"] = "m"
    """Lengths of the files. 3MF files have a unit of their own."""
    remesh: bool = False
    """Make a new surface around meshes that are open, branched or cut through themselves; how far it moves is said."""
    seed: int = 0
    """Of the sizes and of CoACD."""
    coacd_threshold: float | None = None
    """Concavity bound of the convex parts, 0.01 to 1; lower means more parts. Default: 0.1."""
    max_parts: int | None = None
    """Bound on the number of convex parts. Default: set for each authored shape, else none."""
    max_part_error: float = 1.0
    """Refuse objects whose convex parts miss and add more than this share of the volume; from 0.2 on they are named."""
    timeout: float = 300.0
    """Seconds one mesh may take: reading, repair and convex parts together."""
    memory: float = 4.0
    """GiB that a process working on one mesh may take."""
    mass: float | None = None
    """Mass of every object, kg; or --density."""
    density: float | None = None
    """Density of every object, kg/m^3."""
    licence: str = "unknown"
    """Of the meshes, for the manifest."""
    jobs: int = field(default_factory=default_jobs)
    """Meshes worked on at once. Default: one a core."""

    def run(self) -> int:
        """Build, then name every repair and every refusal."""
        from object_sets.building import build

        with progress("building") as report:
            path = build(
                self.out,
                meshes=self.meshes,
                set_name=self.set_name,
                recursive=self.recursive,
                extent=parse_extent(self.extent),
                scales=self.scales,
                center=self.center,
                alignment=self.align,
                max_faces=self.max_faces,
                units=self.units,
                remesh=self.remesh,
                seed=self.seed,
                coacd_threshold=self.coacd_threshold,
                max_parts=self.max_parts,
                max_part_error=self.max_part_error,
                timeout=self.timeout,
                memory=self.memory,
                mass=self.mass,
                density=self.density,
                licence=self.licence,
                jobs=self.jobs,
                progress=report,
            )
        return summary(path)
