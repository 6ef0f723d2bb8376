"""Beside the paper: how fast agents turn. Angle to the goal against time and time to the goal, by goal distance."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from reproduce import style
from reproduce.cells import Cell, empty_cell, estimate_cell, paper_values, range_of, write_cells
from reproduce.courses import OWN
from reproduce.inventory import COURSE, FINGERS, ORACLE, TACTILE
from reproduce.results import Results
from reproduce.style import LINES, PAGE, PAPER, figure, footnote, save, say_missing
from reproduce.tracks import Track, means, median, tracks
from tactile_kit.evaluation.courses import MOMENTS
from tactile_kit.evaluation.rows import SUCCESS_ANGLE
from tactile_kit.evaluation.summary import share

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AGENTS = (
    ("Oracle VecBPS", ORACLE, style.ORACLE),
    ("Tactile, finger cell", FINGERS, LINES[4]),
    ("Tactile VecBPS", TACTILE, style.TACTILE),
)
EDGES = (0, 90, 135, 180)  # degrees from the start to the goal; starts are grasps of any orientation
CUBE = 8  # the object of the lab's number
TIME, ANGLE = "time to 0.4 rad, median (s)", "mean angle to the goal (rad)"
TOLD = (1.0, 2.0, 5.0, 10.0)  # s, at which angles go to the CSV


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: PNG, SVG and a CSV of the numbers."""
    lab = float(paper_values("turning")["lab_seconds"])
    bins = {f"{low} to {high} degrees": (np.radians(low), np.radians(high)) for low, high in pairwise(EDGES)}
    furthest = list(bins)[-1]
    cells: list[Cell] = []
    made, panels = figure(PAGE, 2.3, len(bins) + 1)
    for label, role, colour in AGENTS:
        found = tracks(results.courses(role, COURSE)).get(OWN, [])
        runs = results.measured(role, COURSE)
        mine: list[Track] = []
        for axes, (row, (low, high)) in zip(panels, bins.items(), strict=False):
            mine = [track for track in found if low <= track.start < high]
            angles = means(mine, lambda track: track.values("theta"), results.seed)
            _course(axes, angles, [track.start for track in mine], colour, label)
            cells += _angles(row, label, angles, runs)
            cells += _times(row, label, mine, lab, runs)
        cubes = [track for track in mine if track.object_id == CUBE]  # of the furthest
        cells += _times(f"{furthest}, cube", label, cubes, lab, runs)
        _arrivals(panels[-1], mine, colour, label)
    there = any(cell.n for cell in cells)
    for axes, row in zip(panels, bins, strict=False):
        axes.axhline(SUCCESS_ANGLE, color=PAPER, linewidth=0.8, linestyle="--")
        axes.set_title(f"Goals {row.replace(' degrees', '°')} away")
        axes.set_xlim(0, 10)
        axes.set_ylim(0, 3.2)
        axes.set_xlabel("time (s)")
        if not there:
            say_missing(axes, "missing")
    panels[0].set_ylabel("mean angle to the goal (rad)")
    panels[-1].set_title(f"Reached, {furthest.replace(' degrees', '°')}")
    panels[-1].axvline(lab, color=PAPER, linewidth=0.9, linestyle=":")
    panels[-1].set_xlim(0, 10)
    panels[-1].set_ylim(0, 1.02)
    panels[-1].set_xlabel("time (s)")
    panels[-1].set_ylabel("share of all episodes")
    if there:
        panels[0].legend(*panels[-1].get_legend_handles_labels(), fontsize=7, loc="upper right")
    footnote(
        made,
        f"In Bullet, {range_of(cells)} episodes a number; angles of those still held, bands 95 % intervals."
        f" Dashed: 0.4 rad. Dotted: {lab:g} s, in which the lab's hand turns a cube by 180°.",
    )
    save(made, outputs)
    write_cells(outputs[2], cells)


def _course(axes: Axes, angles: Sequence, starts: list[float], colour: str, label: str) -> None:
    there = [(time, one) for time, one in zip(MOMENTS, angles, strict=False) if one is not None]
    if not there:
        return
    times, start = [0.0, *(time for time, _ in there)], float(np.mean(starts))
    axes.plot(times, [start, *(one.value for _, one in there)], color=colour, linewidth=1.4, label=label)
    low = [start, *(one.value if one.low is None else one.low for _, one in there)]
    high = [start, *(one.value if one.high is None else one.high for _, one in there)]
    axes.fill_between(times, low, high, color=colour, alpha=0.18, linewidth=0)


def _arrivals(axes: Axes, turned: list[Track], colour: str, label: str) -> None:
    if turned:
        times = sorted(track.arrived for track in turned)
        inside = [time for time in times if np.isfinite(time)]
        shares = np.arange(1, len(inside) + 1) / len(turned)
        axes.step(
            [0.0, *inside, 10.0],
            [0.0, *shares, shares[-1] if inside else 0.0],
            where="post",
            color=colour,
            label=label,
        )


def _angles(row: str, label: str, angles: Sequence, runs: Sequence[str]) -> list[Cell]:
    cells = []
    for moment in TOLD:
        column, value = f"{label}, {moment:g} s", angles[MOMENTS.index(moment)] if angles else None
        cells.append(
            empty_cell(row, column, ANGLE, None, "not measured")
            if value is None
            else estimate_cell(row, column, ANGLE, None, value, runs=runs)
        )
    return cells


def _times(row: str, label: str, mine: list[Track], lab: float, runs: Sequence[str]) -> list[Cell]:
    """The median time to 0.4 rad over all episodes, those included that never get there, and shares that do."""
    if not mine:
        return [
            empty_cell(row, label, quantity, None, "not measured")
            for quantity in (TIME, f"share within 0.4 rad by {lab:g} s", "share ever within 0.4 rad")
        ]
    times = [track.arrived for track in mine]
    middle = median(times)
    n = len(times)
    note = "" if middle is None or middle.high is not None else "interval open above, or too few episodes"
    first = (
        empty_cell(row, label, TIME, None, "fewer than half get there", status="undefined", runs=runs, n=n)
        if middle is None
        else estimate_cell(row, label, TIME, None, middle, runs=runs, note=note)
    )
    soon, ever = sum(time <= lab for time in times), sum(np.isfinite(times))
    return [
        first,
        estimate_cell(row, label, f"share within 0.4 rad by {lab:g} s", None, share(soon, n), runs=runs),
        estimate_cell(row, label, "share ever within 0.4 rad", None, share(int(ever), n), runs=runs),
    ]
