"""What several commands share: ranges written as LOW:HIGH, progress, and the last lines of a set that was made."""

from __future__ import annotations

import os
import sys
from pathlib import Path


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


def summary(path: Path) -> int:
    """Print what a manifest says of repairs and refusals; returns the exit code."""
    from object_sets.manifest import Manifest

    manifest = Manifest.from_bytes(path.read_bytes(), path)
    for entry in manifest.objects:
        for repair in entry.repairs:
            print(f"repaired {entry.source}: {repair}")
    print(f"{path}: {len(manifest.objects)} objects, {len(manifest.refused)} refused")
    for item in manifest.refused:
        print(f"refused {item.file}: {item.defect}; remedy: {item.remedy}", file=sys.stderr)
    return 1 if manifest.refused else 0
