"""Table II: ablations of training with the estimator, relative to the tactile VecBPS agent."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from reproduce.cells import MEASURED, UNDEFINED, Cell, empty_cell, estimate_cell, paper_values, write_cells
from reproduce.files import write_atomic
from reproduce.inventory import ABLATED
from reproduce.latex import escape, row, table
from reproduce.results import Results
from reproduce.style import steps_text
from tactile_kit.evaluation.summary import mean_final_angle, relative_change, success_rate

QUANTITIES = (("success", "relative success rate"), ("angle", "relative final angle to goal"))
BASE_ROW = "Base (VecBPS)"


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: CSV and LaTeX."""
    values = paper_values("table2")
    cells = table_cells(results, values)
    write_cells(outputs[0], cells)
    write_atomic(outputs[1], latex(values, cells, results))


def table_cells(results: Results, values: dict) -> list[Cell]:
    """The base model's own rate and mean angle, then one cell an ablation and quantity."""
    base = results.rows(values["base"], "nominal")
    base_runs = results.evaluated(values["base"], "nominal")
    cells = _base_cells(base, base_runs, results)
    for line in values["rows"]:
        role = ABLATED[line["key"]]
        rows, runs = results.rows(role, "nominal"), results.evaluated(role, "nominal")
        steps = results.steps_trained([*runs, *base_runs])
        for quantity, column in QUANTITIES:
            paper = line[quantity]
            if rows is None or base is None:
                why = "run not there" if rows is None else "base run not there"
                cells.append(empty_cell(line["name"], column, column, paper, why))
                continue
            # Objects both were evaluated on: a change must compare like with like.
            shared = {r.object_id for r in rows} & {r.object_id for r in base}
            unlike = results.unlike([values["base"], role])
            change = (
                relative_change(
                    [r for r in rows if r.object_id in shared],
                    [r for r in base if r.object_id in shared],
                    quantity,
                    results.seed,
                )
                if shared and not unlike
                else None
            )
            if change is None:
                why = (
                    "the base model's value is zero: no ratio" if shared else "no object evaluated with both"
                )
                why = unlike or why
                cells.append(
                    empty_cell(
                        line["name"],
                        column,
                        column,
                        paper,
                        why,
                        status=UNDEFINED,
                        runs=runs,
                        steps=steps,
                        n=len(rows),
                    )
                )
            else:
                cells.append(
                    estimate_cell(line["name"], column, column, paper, change, runs=runs, steps=steps)
                )
    return cells


def _base_cells(base: list | None, runs: list[str], results: Results) -> list[Cell]:
    if base is None:
        return [
            empty_cell(BASE_ROW, "success rate", "success rate", None, "run not there"),
            empty_cell(BASE_ROW, "final angle to goal", "mean final angle (rad)", None, "run not there"),
        ]
    steps = results.steps_trained(runs)
    angle = mean_final_angle(base, results.seed)
    return [
        estimate_cell(
            BASE_ROW, "success rate", "success rate", None, success_rate(base), runs=runs, steps=steps
        ),
        estimate_cell(
            BASE_ROW, "final angle to goal", "mean final angle (rad)", None, angle, runs=runs, steps=steps
        ),
    ]


def latex(values: dict, cells: list[Cell], results: Results) -> str:
    """The paper's layout; below our values their intervals, the paper's values, our n; reasons below the table."""
    by_place = {(cell.row, cell.column): cell for cell in cells}
    rate, angle = (cell for cell in cells if cell.row == BASE_ROW)
    marks = _marks(cells)
    lines = [
        row("", "", "relative", "relative final", "trained"),
        row("", "", "success rate", "angle to goal", "for"),
        r"    \midrule",
        row(escape(BASE_ROW), "ours", _absolute(rate, ""), _absolute(angle, r"\,rad"), _trained(rate)),
        row("", r"95\,\% interval", *map(_absolute_interval, (rate, angle)), ""),
        row("", "our episodes", str(rate.n), str(angle.n), ""),
    ]
    for line in values["rows"]:
        mine = [by_place[line["name"], column] for _, column in QUANTITIES]
        name = (
            escape(line["name"]).replace("sigma", r"$\sigma$").replace("through B", r"through $\mathcal{B}$")
        )
        lines += [
            r"    \midrule",
            row(name, "ours", *(_ours(cell, marks) for cell in mine), _trained(mine[0])),
            row("", r"95\,\% interval", *map(_interval, mine), ""),
            row("", "paper", *(_signed(cell.paper) for cell in mine), ""),
            row("", "our episodes", *(str(cell.n) for cell in mine), ""),
        ]
    caption = (
        "Training with estimator: ablations, relative to the VecBPS agent (first row: its own values)."
        f" Scale: {escape(results.scale)}. Bootstrap intervals, Wilson's for the first rate."
    )
    notes = [rf"$^{{{mark}}}$\,{escape(note)}" for note, mark in marks.items()]
    return table("l l c c c", lines, caption, wide=True, notes=notes)


def _marks(cells: list[Cell]) -> dict[str, str]:
    """Why values are undefined, each reason with a letter."""
    reasons = dict.fromkeys(cell.note for cell in cells if cell.status == UNDEFINED)
    return dict(zip(reasons, "abcdefghijklmnopqrstuvwxyz", strict=False))


def _signed(value: float | None) -> str:
    return "--" if value is None else rf"${100 * value:+.1f}\,\%$"


def _ours(cell: Cell, marks: dict[str, str]) -> str:
    if cell.status == UNDEFINED:
        return f"undefined$^{{{marks[cell.note]}}}$"
    return _signed(cell.ours) if cell.status == MEASURED else "missing"


def _interval(cell: Cell) -> str:
    return "--" if cell.low is None else f"[{_signed(cell.low)}, {_signed(cell.high)}]"


def _absolute(cell: Cell, unit: str) -> str:
    return f"{cell.ours:.2f}{unit}" if cell.status == MEASURED else "missing"


def _absolute_interval(cell: Cell) -> str:
    return "--" if cell.low is None else f"[{cell.low:.2f}, {cell.high:.2f}]"


def _trained(cell: Cell) -> str:
    return steps_text([int(text) for text in cell.steps_trained.split()]) if cell.steps_trained else "--"
