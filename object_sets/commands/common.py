"""What several commands share: ranges written as LOW:HIGH, progress, and the last lines of a set that was made."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from object_sets.manifest import Entry

ROUGH = 0.2  # of the volume: parts that differ by more are warned of


def parse_extent(text: str | None) -> tuple[float, float] | None:
    """(lowest, highest) m of LOW:HIGH or one number; None stays None. Raises ``ScaleError``."""
    from object_sets.errors import ScaleError
    from object_sets.importing import check_extent

    if text is None:
        return None
    try:
        low, _, high = text.partition(":")
        values = float(low), float(high or low)
    except ValueError:
        values = (0.0, 0.0)
    if not 0 < values[0] <= values[1] < float("inf"):
        raise ScaleError(f"--extent {text!r}: LOW:HIGH in metres with 0 < LOW <= HIGH is needed")
    check_extent(values, "--extent")
    return values


class progress:
    """A bar with an ETA on a terminal, plain lines without one; on stderr."""

    def __init__(self, doing: str) -> None:
        self.doing = doing

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
            self.task = self.bar.add_task(self.doing, total=None)
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


def default_jobs() -> int:
    """As many as there are cores for this process."""
    return len(os.sched_getaffinity(0))


def _difference(entry: Entry) -> str:
    errors = entry.errors
    return (
        f"{100 * errors.symmetric_difference:.2g} % of its volume (the parts fill {100 * errors.volume:+.2g} %), "
        f"{1000 * errors.hausdorff:.2g} mm"
    )


def summary(path: Path) -> int:
    """Print what a manifest says of repairs and refusals; returns the exit code."""
    from object_sets.manifest import Manifest

    manifest = Manifest.from_bytes(path.read_bytes(), path)
    for entry in manifest.objects:
        for repair in entry.repairs:
            print(f"repaired {entry.source}: {repair}")
    rough = sorted(manifest.objects, key=lambda entry: -entry.errors.symmetric_difference)
    if rough:
        print(f"convex parts: {_difference(rough[0])} at worst ({rough[0].name})")
    for entry in rough:
        if entry.errors.symmetric_difference > ROUGH:
            print(
                f"warning {entry.name}: its {len(entry.parts)} convex parts differ from it by {_difference(entry)}; "
                "lower --coacd-threshold, raise --max-parts, or refuse it by --max-part-error",
                file=sys.stderr,
            )
    print(f"{path}: {len(manifest.objects)} objects, {len(manifest.refused)} refused")
    for item in manifest.refused:
        print(f"refused {item.file}: {item.defect}; remedy: {item.remedy}", file=sys.stderr)
    return 1 if manifest.refused else 0
