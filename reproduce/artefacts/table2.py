"""Table II: ablations of training with the estimator, relative to the tactile VecBPS agent."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from reproduce.cells import MEASURED, UNDEFINED, Cell, empty_cell, estimate_cell, paper_values, write_cells
from reproduce.files import write_atomic
from reproduce.inventory import ABLATED, Results
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
    for row in values["rows"]:
        role = ABLATED[row["key"]]
        rows, runs = results.rows(role, "nominal"), results.evaluated(role, "nominal")
        steps = results.steps_trained([*runs, *base_runs])
        for quantity, column in QUANTITIES:
            paper = row[quantity]
            if rows is None or base is None:
                why = "run not there" if rows is None else "base run not there"
                cells.append(empty_cell(row["name"], column, column, paper, why))
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
                        row["name"],
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
                    estimate_cell(row["name"], column, column, paper, change, runs=runs, steps=steps)
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
    """The paper's layout; a cell reads: ours [95 % interval], then the paper's value and n."""
    by_place = {(cell.row, cell.column): cell for cell in cells}
    base = [cell for cell in cells if cell.row == BASE_ROW]
    lines = [
        "% Needs the packages booktabs and makecell.",
        r"\begin{table}",
        r"  \centering",
        rf"  \caption{{Training with estimator: ablations, relative to the VecBPS agent. Scale: {results.scale}."
        r" Each cell: ours [95\,\% bootstrap interval], then the paper's value and our number of episodes.}",
        r"  \begin{tabular}{l c c c}",
        r"    \toprule",
        r"     & \makecell{relative\\success rate} & \makecell{relative\\final angle to goal} & trained for \\",
        r"    \midrule",
        rf"    {BASE_ROW} & {_base(base[0], '')} & {_base(base[1], ' rad')} & {_trained(base[0])} \\",
        r"    \midrule",
    ]
    for row in values["rows"]:
        mine = [by_place[row["name"], column] for _, column in QUANTITIES]
        name = row["name"].replace("sigma", r"$\sigma$").replace("through B", r"through $\mathcal{B}$")
        lines.append(f"    {name} & " + " & ".join(map(_ours, mine)) + rf" & {_trained(mine[0])} \\")
        lines.append(
            "     & " + " & ".join(f"(paper {_signed(c.paper)}; n = {c.n})" for c in mine) + r" & \\"
        )
    lines += [r"    \bottomrule", r"  \end{tabular}", r"\end{table}"]
    return "\n".join(lines) + "\n"


def _signed(value: float | None) -> str:
    if value is None:
        return "--"
    return rf"${100 * value:+.1f}\,\%$"


def _ours(cell: Cell) -> str:
    if cell.status != MEASURED:
        return "missing" if cell.status != UNDEFINED else f"undefined ({cell.note})"
    interval = "no interval" if cell.low is None else f"{_signed(cell.low)}, {_signed(cell.high)}"
    return f"{_signed(cell.ours)} [{interval}]"


def _base(cell: Cell, unit: str) -> str:
    if cell.status != MEASURED:
        return "missing"
    interval = "no interval" if cell.low is None else f"{cell.low:.2f}, {cell.high:.2f}"
    return f"{cell.ours:.2f}{unit} [{interval}], n = {cell.n}"


def _trained(cell: Cell) -> str:
    return steps_text([int(text) for text in cell.steps_trained.split()]) if cell.steps_trained else "--"
