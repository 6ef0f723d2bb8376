"""Beside the paper: where agents fail, by kind, and the estimate's error up to what touch can't tell apart."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from reproduce.cells import Cell, empty_cell, estimate_cell, range_of, write_cells
from reproduce.courses import OWN
from reproduce.inventory import COURSE, EVALUATED, FINGERS
from reproduce.results import Results
from reproduce.style import GREY, LINES, PAGE, TACTILE, figure, footnote, save, say_missing
from reproduce.tracks import Track, means, tracks
from tactile_kit.evaluation.failures import KINDS, kind_of_moment
from tactile_kit.evaluation.rows import SUCCESS_ANGLE
from tactile_kit.evaluation.summary import share

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = dict(zip(KINDS, (LINES[0], LINES[3], LINES[1], LINES[2]), strict=True))
SHARE, PLAIN, SYMMETRIC = "share of failures", "error at 10 s (rad)", "error at 10 s up to symmetry (rad)"


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: PNG, SVG and a CSV of the numbers."""
    cells: list[Cell] = []
    made, (left, right) = figure(PAGE, 2.8, 2, width_ratios=(1.15, 1))
    shown: list[str] = []
    for role in EVALUATED:
        found, runs = tracks(results.courses(role, COURSE)).get(OWN, []), results.measured(role, COURSE)
        kinds = [kind_of_moment(track.last) for track in found]
        failures = [kind for kind in kinds if kind is not None]
        counts = Counter(failures)
        for kind, words in KINDS.items():
            if not failures:
                why = "no failure" if found else "not measured"
                cells.append(empty_cell(role, words, SHARE, None, why, runs=runs))
                continue
            rate = share(counts[kind], len(failures))
            note = _note(kind, found, kinds)
            cells.append(estimate_cell(role, words, SHARE, None, rate, unit="failures", runs=runs, note=note))
        if failures:
            _bars(left, len(shown), counts, len(found))
            shown.append(f"{role.removesuffix('-geometric8')}, {len(failures)} of {len(found)}")
        cells += _symmetries(role, found, runs, results.seed)
    if shown:
        left.set_yticks(range(len(shown)), shown, fontsize=6)
        left.set_ylim(len(shown) - 0.5, -0.5)
        left.set_xlim(0, 1)
        left.grid(axis="x", color="#e4e6ea")
        left.set_xlabel("share of episodes")
        left.set_title("Failures by kind")
        for kind, words in KINDS.items():
            left.barh([0], [0], color=COLOURS[kind], label=words)
        made.legend(loc="outside upper center", ncols=4, fontsize=7.5)
        _errors(right, cells)
    else:
        for axes in (left, right):
            say_missing(axes, "missing")
    footnote(
        made,
        f"In Bullet, {range_of(cells)} episodes or failures a number. Right: agent of the finger cell, mean error of"
        " its estimate at 10 s where the object is still held, 95 % intervals.",
    )
    save(made, outputs)
    write_cells(outputs[2], cells)


def _note(kind: str, found: list[Track], kinds: Sequence[str | None]) -> str:
    """What else is worth knowing: whether a stalled agent believes to be there."""
    if kind != "stall":
        return ""
    mine = [track.last for track, one in zip(found, kinds, strict=True) if one == kind]
    near = sum(last.believed < SUCCESS_ANGLE for last in mine)
    return f"{near} of {len(mine)} believe to be there"


def _bars(axes: Axes, place: int, counts: Counter, total: int) -> None:
    left = 0.0
    for kind in KINDS:
        width = counts[kind] / total
        axes.barh(place, width, left=left, height=0.62, color=COLOURS[kind])
        left += width


def _last(column: str, track: Track) -> list[float]:
    return [getattr(track.last, column)]


def _symmetries(role: str, found: list[Track], runs: Sequence[str], seed: int) -> list[Cell]:
    """Of tactile agents: mean errors at the end of those held, by object; the paper's and up to symmetry."""
    if not role.startswith("tactile"):
        return []
    cells = []
    for name in dict.fromkeys(track.last.object for track in found):
        mine = [track for track in found if track.last.object == name and track.last.end == "time"]
        for quantity, column in ((PLAIN, "error"), (SYMMETRIC, "symmetric")):
            errors = partial(_last, column)
            (value,) = means(mine, errors, seed) or (None,)
            cells.append(
                empty_cell(role, name, quantity, None, "all dropped", runs=runs)
                if value is None
                else estimate_cell(role, name, quantity, None, value, runs=runs)
            )
    return cells


def _errors(axes: Axes, cells: Sequence[Cell]) -> None:
    mine = [cell for cell in cells if cell.row == FINGERS and "error" in cell.quantity]
    names = list(dict.fromkeys(cell.column for cell in mine))
    for cell in mine:
        place = names.index(cell.column) + (-0.2 if cell.quantity == PLAIN else 0.2)
        axes.bar(place, cell.ours or 0.0, 0.36, color=TACTILE if cell.quantity == PLAIN else GREY)
        if cell.ours is not None and cell.low is not None and cell.high is not None:
            ends = [[max(0.0, cell.ours - cell.low)], [max(0.0, cell.high - cell.ours)]]
            axes.errorbar(place, cell.ours, yerr=ends, color="#222222", linewidth=0.9, capsize=2)
    axes.set_xticks(
        range(len(names)), [name.replace("_", " ") for name in names], rotation=40, ha="right", fontsize=7
    )
    axes.set_title("Error at 10 s, and up to symmetry")
    axes.set_ylabel("rad")
    for colour, words in ((TACTILE, "as the paper measures"), (GREY, "up to symmetry")):
        axes.bar([0], [0], color=colour, label=words)
    axes.set_ylim(0, 1.2 * axes.get_ylim()[1])
    axes.legend(fontsize=6.5, loc="upper right", ncols=2, handlelength=1.0, columnspacing=1.0)
