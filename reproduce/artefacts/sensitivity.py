"""Beside the paper: what limits feeling. Success and error of the estimate, one term of the randomisation at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import randomization
from reproduce.cells import Cell, empty_cell, estimate_cell, write_cells
from reproduce.inventory import FINGERS, SENSITIVITY
from reproduce.results import Results
from reproduce.sensitivity import DEFAULT, EVERYTHING, FACTORS, GROUPS, SEPARATOR
from reproduce.style import ORACLE, PAGE, PALE, PAPER, SOFT, TACTILE, figure, footnote, save
from tactile_kit.evaluation.courses import Moment
from tactile_kit.evaluation.intervals import stratified_bootstrap
from tactile_kit.evaluation.summary import Estimate, share

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {0.0: ORACLE, 2.0: TACTILE}
WORDS = {0.0: "off", 2.0: "twice as wide"}
ERROR = "mean error of the estimate (rad)"


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: PNG, SVG and a CSV of the points."""
    lines = results.courses(FINGERS, SENSITIVITY)
    runs = results.run_names(FINGERS)
    found: dict[str, list[Moment]] = {}
    for line in lines:
        if line.end:
            found.setdefault(line.condition, []).append(line)
    quantities: tuple[tuple[str, Callable[[list[Moment]], Estimate]], ...] = (
        ("success rate", lambda rows: share(sum(row.success for row in rows), len(rows))),
        (ERROR, lambda rows: _mean_error(rows, results.seed)),
    )
    rows = (*GROUPS, EVERYTHING)
    cells: list[Cell] = []
    made, panels = figure(PAGE, 3.2, 2, sharey=True)
    for axes, (quantity, estimate) in zip(panels, quantities, strict=True):
        base = found.get(DEFAULT)
        if base:
            centre = estimate(base)
            cells.append(estimate_cell(DEFAULT, "x 1", quantity, None, centre, runs=runs))
            axes.axvline(centre.value, color=PAPER, linewidth=1.0)
            axes.axvspan(
                centre.low or centre.value, centre.high or centre.value, color=PALE, linewidth=0, zorder=0
            )
        else:
            cells.append(empty_cell(DEFAULT, "x 1", quantity, None, "not measured"))
        for place, group in enumerate(rows):
            for factor in FACTORS:
                mine, column = found.get(f"{group}{SEPARATOR}{factor:g}"), f"x {factor:g}"
                if mine is None:
                    cells.append(empty_cell(group, column, quantity, None, "not measured"))
                    continue
                cell = estimate_cell(group, column, quantity, None, estimate(mine), runs=runs)
                cells.append(cell)
                _point(axes, cell, place + (0.14 if factor > 1 else -0.14), COLOURS[factor])
        axes.set_xlabel(quantity)
        axes.grid(axis="x", color="#e4e6ea")
    for factor in FACTORS:
        panels[1].plot([], [], "o", color=COLOURS[factor], label=WORDS[factor])
    panels[1].plot([], [], color=PAPER, label="default, with its interval")
    made.legend(loc="outside upper right", ncols=3)
    panels[0].set_yticks(range(len(rows)), rows)
    panels[0].set_ylim(len(rows) - 0.5, -0.5)
    counts = {cell.n for cell in cells if cell.n}
    said = f"{max(counts)} episodes a point" if counts else "missing: nobody has measured it"
    missing = sum(cell.status != "measured" for cell in cells) // 2
    tail = f"; {missing} of {2 * len(rows) + 1} conditions are missing" if counts and missing else ""
    footnote(
        made,
        f"{runs[0] if runs else FINGERS} in Bullet, {said}, the same ones at every point; 95 % intervals{tail}.",
    )
    if not counts:
        panels[0].text(0.5, 0.5, "missing", transform=panels[0].transAxes, ha="center", color=SOFT)
    save(made, outputs)
    write_cells(outputs[2], cells)


def _point(axes: Axes, cell: Cell, height: float, colour: str) -> None:
    assert cell.ours is not None
    low, high = (cell.ours if end is None else end for end in (cell.low, cell.high))
    axes.errorbar(
        cell.ours, height, xerr=[[max(0.0, cell.ours - low)], [max(0.0, high - cell.ours)]],
        fmt="o", markersize=3, color=colour, linewidth=1.1, capsize=2,
    )  # fmt: skip


def _mean_error(rows: Sequence[Moment], seed: int) -> Estimate:
    """Mean over episodes of each one's mean error, interval by bootstrap within objects."""
    by_object: dict[int, list[float]] = {}
    for row in rows:
        by_object.setdefault(row.object_id, []).append(row.mean_error)
    strata = [np.array(values) for _, values in sorted(by_object.items())]
    value = float(np.concatenate(strata).mean())
    if max(map(len, strata)) < 2:
        return Estimate(value, None, None, len(rows))
    low, high = stratified_bootstrap(
        strata,
        lambda parts: float(np.concatenate(parts).mean()),
        generator=randomization.stream(seed, "bootstrap", "sensitivity"),
    )
    return Estimate(value, float(low), float(high), len(rows))
