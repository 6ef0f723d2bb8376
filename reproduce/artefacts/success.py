"""Fig. 7 of the paper: success per object of the tactile agent.

The paper stands real-robot bars beside the simulation's. There is no robot here; in their place stand the same agent's
rates in another simulator, under that name.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from reproduce.bars import bar, rates
from reproduce.cells import Cell, paper_values, rate_cell, write_cells
from reproduce.inventory import TACTILE, TRANSFER
from reproduce.labels import object_label, paper_objects
from reproduce.results import Results
from reproduce.style import ELSEWHERE, PAGE, PALE, SOFT, figure, footnote, save, steps_text
from reproduce.style import TACTILE as ORANGE

WIDTH = 0.25  # of a bar
SIMULATION, ANOTHER = "Tactile VecBPS, simulation", "the same in another simulator (MuJoCo)"


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: PNG, SVG and a CSV of the bars."""
    objects = paper_objects()
    means = {i: group["value"] for group in paper_values("success")["class_means"] for i in group["ids"]}
    cells: list[Cell] = []
    made, (axes,) = figure(PAGE, 2.8)
    axes.bar(
        [item.id - 0.27 for item in objects], [means[item.id] for item in objects], WIDTH,
        color=PALE, zorder=2, label="paper: mean of the object's class (Table I)",
    )  # fmt: skip
    columns = (("nominal", SIMULATION, ORANGE, 0.0), (TRANSFER, ANOTHER, ELSEWHERE, 0.27))
    for evaluation, label, colour, shift in columns:
        rows, runs = results.rows(TACTILE, evaluation), results.evaluated(TACTILE, evaluation)
        steps = results.steps_trained(runs)
        name = label if evaluation == "nominal" else "the same in MuJoCo"
        said = f"{name}, {steps_text(steps)}" if rows else f"{name}: missing"
        axes.bar([0], [0], color=colour, label=said)
        why = "not evaluated there" if evaluation == TRANSFER else "run not there"
        for item in objects:
            mine = [row for row in rows or () if row.object_id == item.id]
            # The paper prints no number an object; its class means (Table I) stand for simulation only.
            note = "paper's value: mean of the object's class in Table I" if evaluation == "nominal" else ""
            paper = means[item.id] if evaluation == "nominal" else None
            cell = rate_cell(
                object_label(item), label, paper, mine, runs=runs, steps=steps, missing=why, note=note
            )
            cells.append(cell)
            bar(axes, item.id + shift, WIDTH, cell, colour)
    axes.axvline(7.5, color=PALE, linewidth=0.8)
    for x, side, name in ((7.4, "right", "Geometric 8"), (7.6, "left", "OOD")):
        axes.text(x, 1.11, name, ha=side, va="bottom", fontsize=6.5, color=SOFT)
    axes.set_xticks(
        [item.id for item in objects], [object_label(item, True) for item in objects], fontsize=6.5
    )
    axes.set_xlim(-0.6, len(objects) - 0.4)
    rates(axes)
    axes.set_ylabel("success rate")
    made.legend(loc="outside upper right", ncols=3, fontsize=6.5)
    count = sorted({cell.n for cell in cells if cell.n})
    n = f"{count[0]}" if len(count) == 1 else f"{count[0]} to {count[-1]}" if count else "no"
    footnote(
        made,
        f"Scale {results.scale}. {n} episodes a bar (the paper: 6144), 95 % Wilson intervals. The paper's"
        " second bars are a real robot's; they can't be had here.",
    )
    save(made, outputs)
    write_cells(outputs[2], cells)
