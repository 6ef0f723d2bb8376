"""A cell: one number of a table, bar or curve, beside the paper's, with n and its 95 % interval. Cells go to CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from reproduce.errors import ReproduceError
from reproduce.files import read_csv, read_yaml, write_atomic
from tactile_kit.evaluation.rows import EpisodeRow
from tactile_kit.evaluation.summary import Estimate, success_rate

MEASURED, MISSING, UNDEFINED = "measured", "missing", "undefined"


@dataclass(frozen=True)
class Cell:
    """One shown number. ``ours`` is None unless ``status`` is ``measured``; ``note`` says why."""

    row: str
    column: str
    quantity: str
    paper: float | None
    ours: float | None
    low: float | None
    high: float | None
    n: int
    unit: str  # what n counts
    successes: int | None
    status: str
    note: str
    runs: str
    steps_trained: str

    def __post_init__(self) -> None:
        if self.status not in (MEASURED, MISSING, UNDEFINED):
            raise ReproduceError(f"cell status {self.status!r}; allowed are measured, missing, undefined")
        if (self.ours is None) != (self.status != MEASURED):
            raise ReproduceError(
                f"cell {self.row}/{self.column}: status {self.status} with ours = {self.ours}"
            )


COLUMNS = tuple(field.name for field in fields(Cell))


def estimate_cell(
    row: str,
    column: str,
    quantity: str,
    paper: float | None,
    estimate: Estimate,
    *,
    unit: str = "episodes",
    note: str = "",
    runs: Sequence[str] = (),
    steps: Sequence[int] = (),
) -> Cell:
    """A measured cell."""
    return Cell(
        row,
        column,
        quantity,
        paper,
        estimate.value,
        estimate.low,
        estimate.high,
        estimate.n,
        unit,
        estimate.successes,
        MEASURED,
        note,
        " ".join(runs),
        " ".join(map(str, steps)),
    )


def empty_cell(
    row: str,
    column: str,
    quantity: str,
    paper: float | None,
    note: str,
    *,
    status: str = MISSING,
    unit: str = "episodes",
    runs: Sequence[str] = (),
    steps: Sequence[int] = (),
    n: int = 0,
) -> Cell:
    """A cell without a number; ``note`` says why."""
    return Cell(
        row,
        column,
        quantity,
        paper,
        None,
        None,
        None,
        n,
        unit,
        None,
        status,
        note,
        " ".join(runs),
        " ".join(map(str, steps)),
    )


def rate_cell(
    row: str,
    column: str,
    paper: float | None,
    rows: Sequence[EpisodeRow] | None,
    *,
    runs: Sequence[str] = (),
    steps: Sequence[int] = (),
    missing: str = "run not there",
    note: str = "",
) -> Cell:
    """The success rate of ``rows``; a missing cell where there are none."""
    if not rows:
        return empty_cell(row, column, "success rate", paper, missing)
    return estimate_cell(
        row, column, "success rate", paper, success_rate(rows), runs=runs, steps=steps, note=note
    )


def _text(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def write_cells(path: Path, cells: Iterable[Cell]) -> None:
    """Cells as CSV, one a line; the same cells give the same bytes."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(COLUMNS)
    for cell in cells:
        writer.writerow([_text(getattr(cell, name)) for name in COLUMNS])
    write_atomic(path, buffer.getvalue())


def read_cells(path: Path) -> list[Cell]:
    """Cells back from CSV; ``ReproduceError`` names file and line of what doesn't fit."""
    cells = []
    for number, line in enumerate(read_csv(Path(path)), start=2):
        try:
            values: dict[str, Any] = {name: line[name] for name in COLUMNS}
            for name in ("paper", "ours", "low", "high"):
                values[name] = float(line[name]) if line[name] else None
            values["n"] = int(line["n"])
            values["successes"] = int(line["successes"]) if line["successes"] else None
            cells.append(Cell(**values))
        except (KeyError, ValueError, TypeError) as error:
            raise ReproduceError(
                f"{path}, line {number}: {error}; allowed are the columns {','.join(COLUMNS)}"
            ) from None
    return cells


def paper_values(artefact: str) -> dict:
    """The paper's numbers for an artefact, from ``paper_values/<artefact>.yaml``."""
    return read_yaml(Path(__file__).parent / "paper_values" / f"{artefact}.yaml")


def percent(value: float, digits: int = 0) -> str:
    """0.123 -> '12 %'. Never '-0 %'."""
    text = f"{100 * value:.{digits}f}"
    return f"{text.lstrip('-') if float(text) == 0 else text} %"


def range_of(cells: Iterable[Cell]) -> str:
    """How many samples are behind these cells, in words: ``48 to 624``, or ``No`` where there is none."""
    counts = sorted({cell.n for cell in cells if cell.n})
    if not counts:
        return "No"
    return str(counts[0]) if counts[0] == counts[-1] else f"{counts[0]} to {counts[-1]}"
