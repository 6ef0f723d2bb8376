"""Table I: success rates by object properties, the paper's four agents and what is set beside them on objects 0-12."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from reproduce.cells import MEASURED, Cell, empty_cell, paper_values, rate_cell, write_cells
from reproduce.files import write_atomic
from reproduce.inventory import PLANNER, Results
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
    for index, row in enumerate(values["rows"]):
        for column in values["columns"]:
            role, paper = column["role"], column["values"][index]
            evaluation = column.get("evaluation", "nominal")
            rows = results.rows(role, evaluation)
            runs = results.evaluated(role, evaluation)
            note = cost_text(results) if role == PLANNER and rows else ""
            inside = [r for r in rows or () if r.object_id in row["ids"]]
            absent = sorted(set(row["ids"]) - {r.object_id for r in inside})
            if inside and absent:
                why = f"objects {absent} not evaluated"
                cells.append(empty_cell(row["name"], column["name"], "success rate", paper, why, runs=runs))
                continue
            steps = results.steps_trained(runs)
            cells.append(
                rate_cell(row["name"], column["name"], paper, inside, runs=runs, steps=steps, note=note)
            )
    return cells


def cost_text(results: Results) -> str:
    """What the planner costs in place of training, over all objects it was evaluated on."""
    cost = results.cost
    return "no training" + (f"; {cost['cpu_seconds_per_action']:.2f} s of one core an action" if cost else "")


def latex(values: dict, cells: list[Cell], results: Results) -> str:
    """The paper's layout; a cell reads: ours [95 % interval], the paper's in brackets below, n."""
    by_place = {(cell.row, cell.column): cell for cell in cells}
    names = [column["name"] for column in values["columns"]]
    lines = [
        "% Needs the package booktabs.",
        r"\begin{table}",
        r"  \centering",
        rf"  \caption{{Success rates by object properties. Scale: {results.scale}. Each cell: ours"
        r" [95\,\% Wilson interval], then the paper's value and our number of episodes. Three columns are"
        r" not in the paper: an estimator whose basis points are the fingers' own; a filter in place of the"
        r" estimator of the VecBPS agent, whose policy was trained beside it; the planner, which knows the true state"
        r" and needs no training.}",
        r"  \begin{tabular}{l c " + "c " * len(names) + "}",
        r"    \toprule",
        r"    \multicolumn{2}{c}{Objects} & " + " & ".join(_groups(values["columns"])) + r" \\",
        r"    Description & IDs & "
        + " & ".join(rf"\textit{{{c['head']}}}" for c in values["columns"])
        + r" \\",
        r"    \midrule",
    ]
    for row in values["rows"]:
        ids = ", ".join(map(str, row["ids"]))
        mine = [by_place[row["name"], name] for name in names]
        lines.append(f"    {row['name']} & {ids} & " + " & ".join(map(_ours, mine)) + r" \\")
        lines.append("     & & " + " & ".join(map(_paper, mine)) + r" \\")
    trained = [_trained(by_place, values, name) for name in names]
    lines += [
        r"    \midrule",
        r"    \multicolumn{2}{l}{Trained for} & " + " & ".join(trained) + r" \\",
        r"    \bottomrule",
        r"  \end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _groups(columns: list[dict]) -> list[str]:
    """The upper line of the head."""
    runs = [(name, len(list(run))) for name, run in groupby(columns, key=lambda column: column["group"])]
    return [rf"\multicolumn{{{width}}}{{c}}{{{name}}}" if width > 1 else name for name, width in runs]


def _ours(cell: Cell) -> str:
    if cell.status != MEASURED:
        return "missing"
    return f"{cell.ours:.2f} [{cell.low:.2f}, {cell.high:.2f}]"


def _paper(cell: Cell) -> str:
    paper = "" if cell.paper is None else f"paper {cell.paper:.2f}; "
    return f"({paper}n = {cell.n})"


def _trained(by_place: dict, values: dict, name: str) -> str:
    cells = [by_place[row["name"], name] for row in values["rows"]]
    cell = next((cell for cell in cells if cell.status == MEASURED), None)
    if cell is None:
        return "--"
    return cell.note or steps_text([int(text) for text in cell.steps_trained.split()])
