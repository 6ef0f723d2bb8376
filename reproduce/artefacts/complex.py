"""Fig. 8 of the paper: success on the complex objects 13-15, tactile and oracle."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from reproduce.bars import bar, rates
from reproduce.cells import Cell, rate_cell, write_cells
from reproduce.inventory import ORACLE, TACTILE
from reproduce.labels import complex_objects, object_label
from reproduce.results import Results
from reproduce.style import COLUMN, figure, footnote, save, steps_text
from reproduce.style import ORACLE as BLUE
from reproduce.style import TACTILE as ORANGE


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: PNG, SVG and a CSV of the bars."""
    objects = complex_objects()
    cells: list[Cell] = []
    made, (axes,) = figure(COLUMN, 2.9)
    for role, label, colour, shift in (
        (ORACLE, "Oracle VecBPS", BLUE, -0.2),
        (TACTILE, "Tactile VecBPS", ORANGE, 0.2),
    ):
        rows, runs = results.rows(role, "complex"), results.evaluated(role, "complex")
        steps = results.steps_trained(runs)
        axes.bar(
            [0], [0], color=colour, label=f"{label}, {steps_text(steps)}" if rows else f"{label}: missing"
        )
        for place, item in enumerate(objects):
            mine = [row for row in rows or () if row.object_id == item.id]
            cell = rate_cell(object_label(item), label, None, mine, runs=runs, steps=steps)
            cells.append(cell)
            bar(axes, place + shift, 0.36, cell, colour)
    axes.set_xticks(range(len(objects)), [object_label(item, True) for item in objects])
    axes.set_xlim(-0.6, len(objects) - 0.4)
    rates(axes)
    axes.set_ylabel("success rate")
    made.legend(loc="outside upper center", ncols=1)
    count = sorted({cell.n for cell in cells if cell.n})
    n = f"{count[0]}" if len(count) == 1 else f"{count[0]} to {count[-1]}" if count else "no"
    footnote(
        made,
        f"Scale {results.scale}. {n} episodes a bar (the paper: 6144), 95 % Wilson intervals."
        " Objects 13-15 are stand-ins: the paper's meshes are not public.",
    )
    save(made, outputs)
    write_cells(outputs[2], cells)
