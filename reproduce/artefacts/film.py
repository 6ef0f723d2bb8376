"""The report's film: a tactile agent turning objects, the goal beside, what it believes as a wire frame."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from reproduce.cells import paper_values
from reproduce.files import read_csv, write_atomic
from reproduce.inventory import FINGERS, TACTILE
from reproduce.results import Results

COLUMNS = ("agent", "object", "verdict")


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: a CSV of the episodes; the film lies beside it, as MP4, where there is an agent to film."""
    made, rows = film_of(outputs[0]), []
    made.unlink(missing_ok=True)
    agent = chosen(results)
    if agent is not None:
        import torch

        from tactile_kit.view.film import film

        torch.set_num_threads(1)
        clips = film(agent, made, quiet=True, **paper_values("film"))
        rows = [(agent.name, clip.held.name, clip.verdict()) for clip in clips]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([COLUMNS, *rows])
    write_atomic(outputs[0], text.getvalue())


def chosen(results: Results) -> Path | None:
    """The agent to film: the finger cell's, else the paper's; None where neither is there."""
    names = [name for role in (FINGERS, TACTILE) for name in results.run_names(role)]
    files = [results.content["runs"][name]["agent"] for name in names]
    return next((Path(file).parent for file in files if file is not None), None)


def film_of(table: Path) -> Path:
    """Where the film of this CSV lies."""
    return table.with_suffix(".mp4")


def episodes(table: Path) -> list[dict[str, str]]:
    """What is in the film; nothing where there is none."""
    return read_csv(table) if table.is_file() and film_of(table).is_file() else []
