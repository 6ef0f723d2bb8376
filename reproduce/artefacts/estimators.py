"""Beside the paper: estimators side by side. Errors on the same episodes, calibration, success where each tells a
policy, and what a step costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from reproduce.cells import (
    MEASURED,
    MISSING,
    UNDEFINED,
    Cell,
    empty_cell,
    estimate_cell,
    rate_cell,
    write_cells,
)
from reproduce.courses import BESIDE, FOLLOWING, TELLING, TRUTH, condition
from reproduce.files import write_atomic
from reproduce.inventory import FINGERS, KALMAN, ORACLE, SIDE_BY_SIDE, TACTILE
from reproduce.latex import escape, row, table
from reproduce.results import Results
from reproduce.tracks import Track, means, quotient, tracks
from tactile_kit.evaluation.courses import MOMENTS
from tactile_kit.evaluation.rows import SUCCESS_ANGLE
from tactile_kit.evaluation.summary import Estimate, share

SECONDS = (1.0, 5.0, 10.0)  # of MOMENTS, in the table
TACTILES_POLICY, ORACLES_POLICY = "success, tactile policy", "success, oracle's policy"
ALONE, TOGETHER = "alone", "together"
COSTS = {ALONE: "a step alone", TOGETHER: "a step of many"}
CLOSE, CALIBRATED = "within 0.4 rad at 10 s", "error / sigma"
HEADS = {  # columns, and how they are called in two lines of LaTeX
    **{f"error at {second:g} s": ("error at", f"{second:g} s") for second in SECONDS},
    CLOSE: ("< 0.4 rad", "at 10 s"),
    CALIBRATED: ("error /", "sigma"),
    ORACLES_POLICY: ("success,", "oracle's"),
    TACTILES_POLICY: ("success,", "tactile"),
    COSTS[ALONE]: ("cost", "of one"),
    COSTS[TOGETHER]: ("cost", "of many"),
}


@dataclass(frozen=True)
class Compared:
    """One line: what it is called, its name in files, and the evaluation in which it tells a tactile agent's policy."""

    label: str
    name: str
    told: tuple[str, str] | None = None  # role and evaluation


def compared(results: Results) -> list[Compared]:
    """The learned cells, by their first runs, and what learns nothing; the truth, whose policy acts, is apart."""
    found = []
    for label, role in (("Paper's cell", TACTILE), ("Finger cell", FINGERS)):
        names = results.run_names(role)
        found.append(Compared(label, names[0] if names else role, (role, "nominal")))
    kalman, rest = BESIDE
    return [*found, Compared("Kalman filter", kalman, (TACTILE, KALMAN)), Compared("R0 for ever", rest)]


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: CSV and LaTeX."""
    cells = table_cells(results)
    write_cells(outputs[0], cells)
    write_atomic(outputs[1], latex(cells, results))


def table_cells(results: Results) -> list[Cell]:
    """One cell an estimator and column."""
    beside = tracks(results.courses(ORACLE, SIDE_BY_SIDE))
    costs = results.costs(ORACLE, SIDE_BY_SIDE).get("costs", {})
    oracle = results.measured(ORACLE, SIDE_BY_SIDE)
    cells = [
        *_errors("Truth", None, None, (), results.seed),
        _success("Truth", ORACLES_POLICY, beside.get(TRUTH), oracle),
        empty_cell("Truth", TACTILES_POLICY, "success rate", None, "no tactile agent's", status=UNDEFINED),
        *(_cost("Truth", name, None) for name in COSTS),
    ]
    for line in compared(results):
        following = beside.get(condition(line.name, FOLLOWING))
        cells += _errors(line.label, following, line.name, oracle, results.seed)
        telling = beside.get(condition(line.name, TELLING))
        cells.append(_success(line.label, ORACLES_POLICY, telling, oracle))
        cells.append(_tactile(results, line))
        cells += [_cost(line.label, name, costs.get(line.name, {}).get(name)) for name in COSTS]
    return cells


def _errors(
    label: str, following: list[Track] | None, name: str | None, runs: Sequence[str], seed: int
) -> list[Cell]:
    """Mean errors at some moments, the share within 0.4 rad at the last, and calibration."""
    why, status = ("not measured", MISSING) if name else ("no error", UNDEFINED)
    found: list[tuple[str, str, Estimate | None]] = []
    errors = means(following or [], lambda track: track.values("error"), seed) or [None] * len(MOMENTS)
    for second in SECONDS:
        found.append((f"error at {second:g} s", "mean error (rad)", errors[MOMENTS.index(second)]))
    ends = [track.last for track in following or () if track.last.end == "time"]
    close = share(sum(end.error < SUCCESS_ANGLE for end in ends), len(ends)) if ends else None
    found += [
        (CLOSE, "share", close),
        (CALIBRATED, "root mean square", quotient(following or [], calibration, seed)),
    ]
    return [
        empty_cell(label, column, quantity, None, why, status=status)
        if value is None
        else estimate_cell(label, column, quantity, None, value, runs=runs)
        for column, quantity, value in found
    ]


def calibration(track: Track) -> tuple[float, float]:
    """Sum of squares of error over sigma at an episode's ``MOMENTS``, and their number."""
    pairs = zip(track.values("error"), track.values("sigma"), strict=True)
    ratios = [(error / sigma) ** 2 for error, sigma in pairs if error == error and sigma > 0]
    return sum(ratios), len(ratios)


def _success(label: str, column: str, episodes: list[Track] | None, runs: Sequence[str]) -> Cell:
    if not episodes:
        return empty_cell(label, column, "success rate", None, "not measured")
    drops = sum(track.last.end != "time" for track in episodes)
    rate = share(sum(track.last.success for track in episodes), len(episodes))
    note = f"{drops} dropped"
    return estimate_cell(label, column, "success rate", None, rate, runs=runs, note=note)


def _tactile(results: Results, line: Compared) -> Cell:
    """Success where it tells a tactile agent's policy: its own agent's; the filter the VecBPS agent's."""
    if line.told is None:
        return empty_cell(line.label, TACTILES_POLICY, "success rate", None, "not tried", status=UNDEFINED)
    rows, runs = results.rows(*line.told), results.evaluated(*line.told)
    note = f"{sum(row.drop for row in rows)} dropped" if rows else ""
    steps = results.steps_trained(runs)
    return rate_cell(line.label, TACTILES_POLICY, None, rows, runs=runs, steps=steps, note=note)


def _cost(label: str, name: str, cost: dict | None) -> Cell:
    column, quantity = COSTS[name], "CPU time (µs)"
    if cost is None:
        why, status = ("nothing to do", UNDEFINED) if label == "Truth" else ("not measured", MISSING)
        return empty_cell(label, column, quantity, None, why, status=status, unit="calls")
    many = "" if name == ALONE else f", each of {cost['environments']} environments"
    note = f"median{many}; quartiles {cost['low']:.0f} and {cost['high']:.0f}"
    value = Estimate(cost["median"], None, None, cost["calls"])
    return estimate_cell(label, column, quantity, None, value, unit="calls", note=note)


def latex(cells: list[Cell], results: Results) -> str:
    """Estimators in rows; below each value its interval, and the number of episodes."""
    by_place = {(cell.row, cell.column): cell for cell in cells}
    lines = [row("", "", *(escape(head[0]) for head in HEADS.values()))]
    lines.append(row("", "", *(escape(head[1]) for head in HEADS.values())))
    for label in dict.fromkeys(cell.row for cell in cells):
        mine = [by_place[label, column] for column in HEADS]
        lines += [
            r"    \midrule",
            row(escape(label), "ours", *map(_number, mine)),
            row("", r"95\,\%", *map(_interval, mine)),
            row("", "n", *(str(cell.n) if cell.n else "--" for cell in mine)),
        ]
    caption = (
        "Estimators side by side: following the same episodes of an oracle that is told the truth (errors in rad, root"
        " mean square of error over sigma), and telling the oracle's policy or a tactile agent's (success; the filter"
        " tells that of the paper's cell). Last columns: microseconds of one core a step and environment, medians, of"
        " one environment and of many at once."
        f" Scale: {escape(results.scale)}. Intervals: Wilson's for shares, else bootstrap."
    )
    return table("l l " + " ".join("c" * len(HEADS)), lines, caption, wide=True)


def _number(cell: Cell) -> str:
    if cell.status != MEASURED or cell.ours is None:
        return "--"
    return f"{cell.ours:.0f}" if "(µs)" in cell.quantity else f"{cell.ours:.2f}"


def _interval(cell: Cell) -> str:
    return "--" if cell.low is None else f"[{cell.low:.2f}, {cell.high:.2f}]"
