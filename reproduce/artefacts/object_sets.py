"""Fig. 4 of the paper: the object sets, a picture of objects 0-15."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from reproduce.cells import Cell, estimate_cell, paper_values, write_cells
from reproduce.results import Results
from reproduce.style import reset
from tactile_kit.evaluation.summary import Estimate


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: PNG, SVG and a CSV of what is shown."""
    import object_sets

    reset()
    png, svg, table = outputs
    png.parent.mkdir(parents=True, exist_ok=True)
    object_sets.render_sheet(object_sets.load("all"), png, svg)
    cells: list[Cell] = []
    for group in paper_values("object_sets")["sets"]:
        for item in object_sets.load(group["objects"]):
            row = f"{item.id} {item.name}"
            for axis, extent in zip("xyz", item.extents, strict=True):
                value = Estimate(float(extent), None, None, 1)
                cells.append(
                    estimate_cell(
                        row, group["name"], f"nominal extent {axis} (m)", None, value, unit="meshes"
                    )
                )
    write_cells(table, cells)
