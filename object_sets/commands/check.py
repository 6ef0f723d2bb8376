"""``object-sets check``."""

from __future__ import annotations

import re
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

if TYPE_CHECKING:
    from object_sets.importing import ImportConfig
    from object_sets.limits import Limits
    from object_sets.reading import Readers

from object_sets.commands.common import default_jobs, parse_extent, progress


@dataclass(frozen=True)
class Check:
    """Say of each mesh file whether it can be used, what would be repaired, or why it is refused.

    Of a set that `object-sets` made, digests are verified and everything that the manifest says of its objects is
    measured again. The exit code is 1 when anything is refused.
    """

    files: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Mesh files, folders of them, or sets made by `object-sets build` or `sample`."""
    recursive: bool = False
    """Look into the folders of folders too."""
    extent: str | None = None
    """Range of extents in metres, LOW:HIGH, to scale to. Without it sizes stay."""
    max_faces: int = 4000
    """Denser meshes are simplified, the surface moving by at most 1 % of the size."""
    units: Literal["m", "cm", "mm", "inch"] = "m"
    """Lengths of the files. 3MF files have a unit of their own."""
    remesh: bool = False
    """Make a new surface around meshes that are open, branched or cut through themselves; how far it moves is said."""
    timeout: float = 300.0
    """Seconds one file may take."""
    memory: float = 4.0
    """GiB that the process reading a file may take."""
    report: Path | None = None
    """JSON file to write: of each file its outcome, repairs, defect and remedy."""
    jobs: int = field(default_factory=default_jobs)
    """Files worked on at once. Default: one a core."""

    def run(self) -> int:
        """Check one after the other, print a line each, and count at the end."""
        from object_sets.errors import ObjectSetError
        from object_sets.importing import ImportConfig
        from object_sets.limits import Limits, stop_all_workers
        from object_sets.reading import Readers
        from object_sets.storage import check_file_writable, json_bytes, write_atomic

        if not self.files:
            raise ObjectSetError("check: nothing to check; give mesh files, folders of them, or sets")
        if self.report is not None:
            check_file_writable(self.report, "--report")

        config = ImportConfig(parse_extent(self.extent), self.max_faces, units=self.units, remesh=self.remesh)
        limits = Limits(self.memory, self.timeout)
        files = self._files()
        rows = []
        with Readers() as readers, progress("checking") as report, ThreadPoolExecutor(self.jobs) as pool:
            futures = [pool.submit(_row, file, config, limits, readers) for file in files]
            try:
                for done, (file, future) in enumerate(zip(files, futures, strict=True), 1):
                    rows.append(future.result())
                    report(str(file), done, len(files))
            except BaseException:  # an interrupt waits neither for what is under way nor for what is to come
                pool.shutdown(wait=False, cancel_futures=True)
                stop_all_workers()
                raise
        for row in rows:
            _show(row)
        counts = Counter(row["outcome"] for row in rows)
        print(", ".join(f"{counts[key]} {key}" for key in ("ok", "repaired", "refused")))
        # Numbers in a reason differ from file to file; the kind of reason is what is counted.
        kinds = Counter(
            re.sub(r"[-+]?\d[\d.e+-]*", "N", row["defect"]) for row in rows if row["outcome"] == "refused"
        )
        for kind, count in kinds.most_common() if len(rows) > 1 else ():
            print(f"{count:>5} refused: {kind}")
        if self.report is not None:
            write_atomic(self.report, json_bytes(rows))
        return 1 if counts["refused"] else 0

    def _files(self) -> list[Path]:
        from object_sets.importing import mesh_files

        files: list[Path] = []
        for file in self.files:
            is_set = file.name == "manifest.json" or (file / "manifest.json").is_file()
            files += mesh_files(file, self.recursive) if file.is_dir() and not is_set else [file]
        return files


def _row(file: Path, config: ImportConfig, limits: Limits, readers: Readers) -> dict[str, Any]:
    from object_sets.errors import MeshError, ObjectSetError
    from object_sets.mass import mass_properties
    from object_sets.verification import verify

    row: dict[str, Any] = {"file": str(file), "outcome": "ok", "repairs": []}
    try:
        if file.is_dir() or file.name == "manifest.json":
            return {**row, "objects": verify(file)}
        mesh = readers.read(file, config, limits)
    except MeshError as error:
        return {**row, "outcome": "refused", "defect": error.defect, "remedy": error.remedy}
    except ObjectSetError as error:
        return {**row, "outcome": "refused", "defect": str(error), "remedy": "build the set again"}
    extents = mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0)
    return {
        **row,
        # A scale that was asked for is no repair.
        "outcome": "repaired" if any(not r.startswith("scaled by") for r in mesh.repairs) else "ok",
        "repairs": list(mesh.repairs),
        "extents": [float(f"{side:.6g}") for side in extents],
        "volume": float(f"{mass_properties(mesh.vertices, mesh.faces).volume:.6g}"),
        "faces": len(mesh.faces),
    }


def _show(row: dict[str, Any]) -> None:
    if row["outcome"] == "refused":
        print(f"refused  {row['file']}: {row['defect']}; remedy: {row['remedy']}")
    elif "objects" in row:
        print(f"ok       {row['file']}: {row['objects']} objects, digests verified, figures measured again")
    else:
        size = " x ".join(f"{1000 * side:.1f}" for side in row["extents"])
        print(
            f"{row['outcome']:<8} {row['file']}: {size} mm, {1e6 * row['volume']:.1f} cm^3, {row['faces']} faces"
        )
        for repair in row["repairs"]:
            print(f"         {repair}")
    sys.stdout.flush()
