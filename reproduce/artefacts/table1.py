"""Table I: success rates by object properties, the paper's four agents and what is set beside them on objects 0-12."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from reproduce.cells import MEASURED, Cell, empty_cell, paper_values, rate_cell, write_cells
from reproduce.files import write_atomic
from reproduce.inventory import PLANNER
from reproduce.latex import escape, row, table
from reproduce.results import Results
from reproduce.style import steps_text


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: CSV and LaTeX."""
    values = paper_values("table1")
    cells = table_cells(results, values)
    write_cells(outputs[0], cells)
    write_atomic(outputs[1], latex(values, cells, results))


def table_cells(results: Results, values: dict) -> list[Cell]:
    """One cell an object class and agent. A class with an object missing is missing: its mean would be another one."""
    cells = []
    for index, line in enumerate(values["rows"]):
        for column in values["columns"]:
            role, paper = column["role"], column["values"][index]
            evaluation = column.get("evaluation", "nominal")
            rows = results.rows(role, evaluation)
            runs = results.evaluated(role, evaluation)
            note = cost_text(results) if role == PLANNER and rows else ""
            inside = [r for r in rows or () if r.object_id in line["ids"]]
            absent = sorted(set(line["ids"]) - {r.object_id for r in inside})
            if inside and absent:
                why = f"objects {absent} not evaluated"
                cells.append(empty_cell(line["name"], column["name"], "success rate", paper, why, runs=runs))
                continue
            steps = results.steps_trained(runs)
            cells.append(
                rate_cell(line["name"], column["name"], paper, inside, runs=runs, steps=steps, note=note)
            )
    return cells


def cost_text(results: Results) -> str:
    """What the planner costs in place of training, over all objects it was evaluated on."""
    cost = results.cost
    return "no training" + (f"; {cost['cpu_seconds_per_action']:.2f} s of one core an action" if cost else "")


def latex(values: dict, cells: list[Cell], results: Results) -> str:
    """The paper's layout over both columns; below a class's rates their intervals, the paper's rates, our n."""
    by_place = {(cell.row, cell.column): cell for cell in cells}
    columns = values["columns"]
    names = [column["name"] for column in columns]
    lines = [
        row(r"\multicolumn{2}{c}{Objects}", *_groups(columns)),
        row("Description", "IDs", *(rf"\textit{{{escape(column['head'])}}}" for column in columns)),
    ]
    for line in values["rows"]:
        mine = [by_place[line["name"], name] for name in names]
        ids = ", ".join(map(str, line["ids"]))
        lines += [
            r"    \midrule",
            row(escape(line["name"]), ids, *map(_number, mine)),
            row("", r"95\,\% interval", *map(_interval, mine)),
            row("", "paper", *("--" if cell.paper is None else f"{cell.paper:.2f}" for cell in mine)),
            row("", "our episodes", *(str(cell.n) for cell in mine)),
        ]
    trained = [_trained(by_place, values, name) for name in names]
    lines += [r"    \midrule", row(r"\multicolumn{2}{l}{Environment steps}", *map(escape, trained))]
    cost = next((f" ({cell.note})" for cell in cells if cell.status == MEASURED and cell.note), "")
    caption = (
        f"Success rates by object properties. Scale: {escape(results.scale)}. Wilson intervals. Three columns are not"
        " in the paper: an estimator whose basis points are the fingers' own; a filter in place of the estimator of"
        " the VecBPS agent, whose policy was trained beside it; the planner, which knows the true state"
        f"{escape(cost)}."
    )
    return table("l l " + " ".join("c" * len(names)), lines, caption, wide=True)


def _groups(columns: list[dict]) -> list[str]:
    """The upper line of the head."""
    runs = [(escape(name), len(list(run))) for name, run in groupby(columns, key=lambda c: c["group"])]
    return [rf"\multicolumn{{{width}}}{{c}}{{{name}}}" if width > 1 else name for name, width in runs]


def _number(cell: Cell) -> str:
    return "missing" if cell.status != MEASURED else f"{cell.ours:.2f}"


def _interval(cell: Cell) -> str:
    return f"[{cell.low:.2f}, {cell.high:.2f}]" if cell.status == MEASURED else "--"


def _trained(by_place: dict, values: dict, name: str) -> str:
    """Steps behind a column, none for what was not trained; what that costs instead stands in the caption."""
    cells = [by_place[line["name"], name] for line in values["rows"]]
    cell = next((cell for cell in cells if cell.status == MEASURED), None)
    if cell is None:
        return "--"
    counted = [int(text) for text in cell.steps_trained.split()]
    return steps_text(counted).removesuffix(" steps") if counted else "none"
