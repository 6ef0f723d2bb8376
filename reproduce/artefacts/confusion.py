"""Fig. 10 of the paper: success by the mesh the agent is told of (rows) and the object it holds (columns)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from reproduce.cells import Cell, rate_cell, write_cells
from reproduce.inventory import TACTILE
from reproduce.labels import object_label, paper_objects
from reproduce.results import Results
from reproduce.style import COLUMN, GREY, figure, save, steps_text
from tactile_kit.evaluation.summary import group


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: PNG, SVG and a CSV of the 13 x 13 cells."""
    import matplotlib

    objects = paper_objects()
    rows, runs = results.rows(TACTILE, "confusion"), results.evaluated(TACTILE, "confusion")
    steps = results.steps_trained(runs)
    cells = matrix_cells(results, objects)
    rates = np.array([np.nan if cell.ours is None else 100 * cell.ours for cell in cells]).reshape(
        len(objects), -1
    )
    made, (axes,) = figure(COLUMN, 3.05)
    colours = matplotlib.colormaps["viridis"].with_extremes(bad="#f1f2f4")
    # The colours span 0 to 100 % whatever the rates: a weak agent must look weak.
    image = axes.imshow(np.ma.masked_invalid(rates), cmap=colours, vmin=0, vmax=100)
    for (i, j), rate in np.ndenumerate(rates):
        text, colour = ("–", GREY) if np.isnan(rate) else (f"{rate:.0f}", "white" if rate < 65 else "black")
        weight = "bold" if i == j else "normal"
        axes.text(j, i, text, ha="center", va="center", fontsize=5, color=colour, fontweight=weight)
    axes.grid(False)
    axes.tick_params(length=0)
    axes.set_xticks(range(len(objects)), [str(item.id) for item in objects], fontsize=6.5)
    axes.set_yticks(range(len(objects)), [object_label(item) for item in objects], fontsize=6.5)
    axes.set_xlabel("object manipulated")
    axes.set_ylabel("mesh given to policy and estimator")
    axes.spines[:].set_visible(False)
    bar = made.colorbar(image, ax=axes, shrink=0.7, aspect=30, pad=0.02)
    bar.set_label("success rate (%)")
    bar.outline.set_visible(False)
    counts = sorted({cell.n for cell in cells if cell.n})
    n = (
        "missing: the tactile agent was not evaluated"
        if rows is None
        else (
            f"{counts[0]} episodes a cell"
            if len(counts) == 1
            else f"{counts[0]} to {counts[-1]} episodes a cell"
        )
    )
    trained = f"; tactile VecBPS, {steps_text(steps)}" if steps else ""
    made.suptitle(f"Success in %, scale {results.scale}{trained}\n{n} (the paper: 6144)", fontsize=7)
    save(made, outputs)
    write_cells(outputs[2], cells)


def matrix_cells(results: Results, objects: Sequence) -> list[Cell]:
    """Row-major: mesh given, then object manipulated."""
    rows, runs = results.rows(TACTILE, "confusion"), results.evaluated(TACTILE, "confusion")
    steps = results.steps_trained(runs)
    by_pair = group(rows or (), lambda row: (row.given_id, row.object_id))
    why = "run not there" if rows is None else "pair not evaluated"
    return [
        rate_cell(
            f"given {object_label(given)}",
            f"manipulated {object_label(held)}",
            None,
            by_pair.get((given.id, held.id)),
            runs=runs,
            steps=steps,
            missing=why,
        )
        for given in objects
        for held in objects
    ]
