"""Beside the paper: the agents in another simulator, by Table I's classes; what the paper asked of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from reproduce.bars import bar, rates
from reproduce.cells import Cell, paper_values, range_of, rate_cell, write_cells
from reproduce.inventory import TRANSFER, TRANSFERRED
from reproduce.results import Results
from reproduce.style import ELSEWHERE, ORACLE, PAGE, TACTILE, figure, footnote, save, steps_text

LABELS = ("Oracle VecBPS", "Tactile VecBPS, finger cell", "Tactile VecBPS")
COLOURS = (ORACLE, TACTILE, TACTILE)
HERE, THERE = "Bullet", "another simulator (MuJoCo)"


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: PNG, SVG and a CSV of the bars."""
    classes = paper_values("table1")["rows"]
    everything = {"name": "All", "ids": [i for line in classes for i in line["ids"]]}
    cells: list[Cell] = []
    made, panels = figure(PAGE, 2.6, len(LABELS), sharey=True)
    for axes, role, label, colour in zip(panels, TRANSFERRED, LABELS, COLOURS, strict=True):
        for evaluation, world, tone, shift in (
            ("nominal", HERE, colour, -0.2),
            (TRANSFER, THERE, ELSEWHERE, 0.2),
        ):
            rows, runs = results.rows(role, evaluation), results.evaluated(role, evaluation)
            steps = results.steps_trained(runs)
            for place, line in enumerate((everything, *classes)):
                mine = [row for row in rows or () if row.object_id in line["ids"]]
                cell = rate_cell(
                    line["name"], f"{label}, {world}", None, mine, runs=runs, steps=steps,
                    missing="not evaluated there" if evaluation == TRANSFER else "run not there",
                )  # fmt: skip
                cells.append(cell)
                bar(axes, place + shift, 0.36, cell, tone)
        known = results.steps_trained(results.run_names(role))
        axes.set_title(f"{label}\n{steps_text(known)}" if known else f"{label}: missing")
        axes.set_xticks(range(4), [line["name"].replace("-", "-\n") for line in (everything, *classes)])
        axes.set_xlim(-0.6, 3.6)
        rates(axes)
    panels[0].set_ylabel("success rate")
    for colour, name in ((ORACLE, f"oracle, {HERE}"), (TACTILE, f"tactile, {HERE}"), (ELSEWHERE, THERE)):
        panels[0].bar([0], [0], color=colour, label=name)
    made.legend(loc="outside upper right", ncols=3)
    footnote(
        made,
        f"Scale {results.scale}. {range_of(cells)} episodes a bar, 95 % Wilson intervals. Objects 0-12, full gravity,"
        " the same randomisation, goals and grasping heuristic in both.",
    )
    save(made, outputs)
    write_cells(outputs[2], cells)
