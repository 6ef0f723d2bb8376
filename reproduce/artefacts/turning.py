"""Beside the paper: how fast agents turn. Angle to the goal against time and time to the goal, by goal distance."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from reproduce import style
from reproduce.cells import Cell, empty_cell, estimate_cell, paper_values, range_of, write_cells
from reproduce.courses import OWN
from reproduce.inventory import COURSE, FINGERS, ORACLE, TACTILE
from reproduce.results import Results
from reproduce.style import LINES, PAPER, figure, footnote, save, say_missing
from reproduce.tracks import Track, means, median, tracks
from tactile_kit.evaluation.courses import MOMENTS
from tactile_kit.evaluation.rows import SUCCESS_ANGLE
from tactile_kit.evaluation.summary import share
from tactile_kit.rotations import geodesic, octahedral

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AGENTS = (
    ("Oracle VecBPS", ORACLE, style.ORACLE),
    ("Tactile, finger cell", FINGERS, LINES[4]),
    ("Tactile VecBPS", TACTILE, style.TACTILE),
)
DISTANCES = (
    90,
    120,
    180,
)  # degrees from the start to the goals of the octahedral group, the start itself left out
CUBE = 8  # the object of the lab's number
TIME, ANGLE = "time to 0.4 rad, median (s)", "mean angle to the goal (rad)"
TOLD = (1.0, 2.0, 5.0, 10.0)  # s, at which angles go to the CSV


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: PNG, SVG and a CSV of the numbers."""
    lab = float(paper_values("turning")["lab_seconds"])
    goals = np.degrees(geodesic(octahedral(), np.eye(3))).round().astype(int)
    cells: list[Cell] = []
    made, panels = figure(11.5, 3.3, len(DISTANCES) + 1)
    for label, role, colour in AGENTS:
        found = tracks(results.courses(role, COURSE)).get(OWN, [])
        runs = results.measured(role, COURSE)
        for axes, distance in zip(panels, DISTANCES, strict=False):
            mine = [track for track in found if goals[track.last.goal] == distance]
            angles = means(mine, lambda track: track.values("theta"), results.seed)
            _course(axes, angles, np.radians(distance), colour, label)
            cells += _angles(f"{distance} degrees", label, angles, runs)
            cells += _times(f"{distance} degrees", label, mine, lab, runs)
        turned = [track for track in found if goals[track.last.goal] == DISTANCES[-1]]
        cubes = [track for track in turned if track.object_id == CUBE]
        cells += _times(f"{DISTANCES[-1]} degrees, cube", label, cubes, lab, runs)
        _arrivals(panels[-1], turned, colour, label)
    there = any(cell.n for cell in cells)
    for axes, distance in zip(panels, DISTANCES, strict=False):
        axes.axhline(SUCCESS_ANGLE, color=PAPER, linewidth=0.8, linestyle="--")
        axes.set_title(f"Goals {distance}° away")
        axes.set_xlim(0, 10)
        axes.set_ylim(0, 3.2)
        axes.set_xlabel("time (s)")
        if not there:
            say_missing(axes, "missing")
    panels[0].set_ylabel("mean angle to the goal (rad)")
    panels[-1].set_title(f"Within 0.4 rad so far, {DISTANCES[-1]}°")
    panels[-1].axvline(lab, color=PAPER, linewidth=0.9, linestyle=":")
    panels[-1].set_xlim(0, 10)
    panels[-1].set_ylim(0, 1.02)
    panels[-1].set_xlabel("time (s)")
    panels[-1].set_ylabel("share of all episodes")
    if there:
        panels[-1].legend(fontsize=7, loc="lower right")
    footnote(
        made,
        f"In Bullet, {range_of(cells)} episodes a number; angles of those still held, bands 95 % intervals."
        f" Dashed: 0.4 rad. Dotted: {lab:g} s, in which the lab's hand turns a cube by 180°.",
    )
    save(made, outputs)
    write_cells(outputs[2], cells)


def _course(axes: Axes, angles: Sequence, start: float, colour: str, label: str) -> None:
    there = [(time, one) for time, one in zip(MOMENTS, angles, strict=False) if one is not None]
    if not there:
        return
    times = [0.0, *(time for time, _ in there)]
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
    note = "" if middle is None or middle.high is not None else "interval open above"
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
