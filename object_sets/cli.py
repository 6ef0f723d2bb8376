"""The command ``object-sets``: list, build, check, render. Every subcommand calls one function of the package."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

SetName = Literal["geometric8", "ood", "complex", "paper", "all"]


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


@dataclass(frozen=True)
class Build:
    """Build a set: authored shapes or a folder of meshes in, npz files and a manifest out.

    A mesh that can't be used never stops the others; it is named at the end, and the exit code is 1.
    """

    set_name: Annotated[SetName | None, tyro.conf.Positional] = None
    """An authored set; or give --meshes."""
    meshes: Path | None = None
    """Folder of STL, OBJ, PLY, GLB/GLTF, OFF or 3MF files."""
    out: Path = Path("object-set")
    """Directory to write."""
    extent: str | None = None
    """Range of extents in metres, LOW:HIGH, for example 0.045:0.09."""
    scales: int = 0
    """Prepared sizes an object, each axis drawn uniformly from --extent."""
    seed: int = 0
    """Of the sizes and of CoACD."""
    coacd_threshold: float | None = None
    """Concavity bound of the convex parts, 0.01 to 1; lower means more parts. Default: 0.1."""
    max_parts: int | None = None
    """Bound on the number of convex parts. Default: set for each authored shape, else none."""
    timeout: float = 300.0
    """Seconds CoACD may take for one mesh."""
    mass: float | None = None
    """Mass of every object, kg; or --density."""
    density: float | None = None
    """Density of every object, kg/m^3."""
    licence: str = "unknown"
    """Of the meshes, for the manifest."""
    jobs: int = 1
    """Meshes worked on at once."""

    def run(self) -> int:
        from object_sets.building import build
        from object_sets.manifest import Manifest

        with _progress() as report:
            path = build(
                self.out,
                meshes=self.meshes,
                set_name=self.set_name,
                extent=_extent(self.extent),
                scales=self.scales,
                seed=self.seed,
                coacd_threshold=self.coacd_threshold,
                max_parts=self.max_parts,
                timeout=self.timeout,
                mass=self.mass,
                density=self.density,
                licence=self.licence,
                jobs=self.jobs,
                progress=report,
            )
        manifest = Manifest.from_bytes(path.read_bytes(), path)
        for entry in manifest.objects:
            for repair in entry.repairs:
                print(f"repaired {entry.source}: {repair}")
        print(f"{path}: {len(manifest.objects)} objects, {len(manifest.refused)} refused")
        for item in manifest.refused:
            print(f"refused {item.file}: {item.defect}; remedy: {item.remedy}", file=sys.stderr)
        return 1 if manifest.refused else 0


@dataclass(frozen=True)
class Check:
    """Say of each mesh file whether it can be used, what would be repaired, or why it is refused."""

    files: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Mesh files, or directories made by `object-sets build` (digests are verified)."""
    extent: str | None = None
    """Range of extents in metres, LOW:HIGH, to scale to."""

    def run(self) -> int:
        from object_sets import MeshError, ObjectSetError, load
        from object_sets.importing import read_mesh
        from object_sets.mass import mass_properties

        extent = _extent(self.extent)
        bad = 0
        for file in self.files:
            try:
                if file.is_dir() or file.name == "manifest.json":
                    print(f"ok       {file}: {len(load(file))} objects, digests verified")
                    continue
                mesh = read_mesh(file, extent)
            except MeshError as error:
                bad += 1
                print(f"refused  {error}")
                continue
            except ObjectSetError as error:
                bad += 1
                print(f"refused  {file}: {error}")
                continue
            size = " x ".join(f"{1000 * side:.1f}" for side in mesh.vertices.max(axis=0) * 2.0)
            volume = 1e6 * mass_properties(mesh.vertices, mesh.faces).volume
            print(f"{'repaired' if mesh.repairs else 'ok      '} {file}: {size} mm, {volume:.1f} cm^3, "
                  f"{len(mesh.faces)} faces")  # fmt: skip
            for repair in mesh.repairs:
                print(f"         {repair}")
        return 1 if bad else 0


@dataclass(frozen=True)
class Render:
    """Draw a contact sheet of a set."""

    objects: Annotated[str, tyro.conf.Positional]
    """A set, a comma list of sets, names and ids, or a directory made by `object-sets build`."""
    out: Path = Path("object_sets.png")
    """PNG file to write."""
    svg: Path | None = None
    """SVG file to write as well."""

    def run(self) -> int:
        from object_sets import render_sheet, select

        chosen = select(self.objects)
        render_sheet(chosen, self.out, self.svg)
        print(f"{self.out}: {len(chosen)} objects")
        return 0


Command = (
    Annotated[List, tyro.conf.subcommand("list")]
    | Annotated[Build, tyro.conf.subcommand("build")]
    | Annotated[Check, tyro.conf.subcommand("check")]
    | Annotated[Render, tyro.conf.subcommand("render")]
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 fine, 1 something was refused, 2 wrong arguments."""
    from object_sets.errors import ObjectSetError

    command = tyro.cli(
        Command, args=arguments, prog="object-sets", description=__doc__, config=(tyro.conf.OmitArgPrefixes,)
    )
    try:
        return command.run()
    except ObjectSetError as error:
        print(f"object-sets: {error}", file=sys.stderr)
        return 1


def _extent(text: str | None) -> tuple[float, float] | None:
    from object_sets.errors import ScaleError

    if text is None:
        return None
    try:
        low, _, high = text.partition(":")
        values = float(low), float(high or low)
    except ValueError:
        values = (0.0, 0.0)
    if not 0 < values[0] <= values[1] < float("inf"):
        raise ScaleError(f"--extent {text!r}: LOW:HIGH in metres with 0 < LOW <= HIGH is needed")
    return values


class _progress:
    """A bar with an ETA on a terminal, plain lines without one; on stderr."""

    def __enter__(self):
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        console = Console(stderr=True)
        self.bar = None
        if console.is_terminal:
            columns = (
                TextColumn("{task.description}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeRemainingColumn(),
            )
            self.bar = Progress(*columns, console=console)
            self.bar.start()
            self.task = self.bar.add_task("building", total=None)
        return self.report

    def report(self, label: str, done: int, total: int) -> None:
        """One object is ready."""
        if self.bar is not None:
            self.bar.update(self.task, description=label, completed=done, total=total)
        else:
            print(f"[{done}/{total}] {label}", file=sys.stderr, flush=True)

    def __exit__(self, *_: object) -> None:
        if self.bar is not None:
            self.bar.stop()


if __name__ == "__main__":
    sys.exit(main())
