"""Beside the paper: how estimators drift. Error against time by Table I's classes, and whether sigma says how much."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from reproduce.artefacts.estimators import compared
from reproduce.cells import Cell, empty_cell, estimate_cell, paper_values, range_of, write_cells
from reproduce.courses import FOLLOWING, condition
from reproduce.inventory import ORACLE, SIDE_BY_SIDE
from reproduce.results import Results
from reproduce.style import GREY, LINES, PAGE, PAPER, figure, footnote, save, say_missing
from reproduce.tracks import Track, means, quotient, tracks
from tactile_kit.evaluation.courses import MOMENTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Terms = Callable[[Track], tuple[float, float]]
COLOURS = (LINES[1], LINES[2], LINES[4], GREY)
TOLD = (1.0, 2.0, 5.0, 10.0)  # s, at which errors go to the CSV
BINS = 6  # of sigma, with equally many moments each
ERROR, RELIABILITY = "mean error (rad)", "RMS error (rad) where sigma is about that"


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: PNG, SVG and a CSV of the points."""
    beside = tracks(results.courses(ORACLE, SIDE_BY_SIDE))
    runs = results.measured(ORACLE, SIDE_BY_SIDE)
    classes = paper_values("table1")["rows"]
    cells: list[Cell] = []
    made, panels = figure(PAGE, 2.3, len(classes) + 1)
    for line, colour in zip(compared(results), COLOURS, strict=True):
        found = beside.get(condition(line.name, FOLLOWING), [])
        for axes, kind in zip(panels, classes, strict=False):
            mine = [track for track in found if track.object_id in kind["ids"]]
            estimates = means(mine, lambda track: track.values("error"), results.seed)
            _course(axes, estimates, colour, line.label)
            for moment in TOLD:
                column, value = f"{line.label}, {moment:g} s", None
                if estimates:
                    value = estimates[MOMENTS.index(moment)]
                cells.append(
                    empty_cell(kind["name"], column, ERROR, None, "not measured")
                    if value is None
                    else estimate_cell(kind["name"], column, ERROR, None, value, runs=runs)
                )
        cells += _reliability(panels[-1], found, line.label, colour, runs, results.seed)
    for axes, kind in zip(panels, classes, strict=False):
        axes.set_title(kind["name"])
        axes.set_xlabel("time (s)")
        axes.set_xlim(0, 10)
        axes.set_ylim(0, 2.5)
        if not beside:
            say_missing(axes, "missing")
    panels[0].set_ylabel("mean error of the estimate (rad)")
    _diagonal(panels[-1])
    if beside:
        panels[0].legend(fontsize=7, loc="center right", bbox_to_anchor=(1.0, 0.46))
    footnote(
        made,
        f"{runs[0] if runs else ORACLE} in Bullet, told the truth; all estimators follow the same episodes"
        f" ({range_of(cells)} a point), those still held. Bands and bars: 95 % intervals.",
    )
    save(made, outputs)
    write_cells(outputs[2], cells)


def _course(axes: Axes, estimates: Sequence, colour: str, label: str) -> None:
    there = [(time, one) for time, one in zip(MOMENTS, estimates, strict=False) if one is not None]
    if not there:
        return
    times = [0.0, *(time for time, _ in there)]
    for_bands = [
        (one.value if one.low is None else one.low, one.value if one.high is None else one.high)
        for _, one in there
    ]
    axes.plot(times, [0.0, *(one.value for _, one in there)], color=colour, linewidth=1.4, label=label)
    axes.fill_between(
        times, [0.0, *(low for low, _ in for_bands)], [0.0, *(high for _, high in for_bands)], color=colour, alpha=0.18,
        linewidth=0,
    )  # fmt: skip


def _reliability(
    axes: Axes, found: list[Track], label: str, colour: str, runs: Sequence[str], seed: int
) -> list[Cell]:
    """One cell and point a bin of sigma: the error's root mean square against sigma's."""
    sigmas = np.array([sigma for track in found for sigma in track.values("sigma")])
    sigmas = sigmas[np.isfinite(sigmas)]
    if not len(sigmas):
        return [empty_cell("sigma", label, RELIABILITY, None, "not measured")]
    edges = np.unique(np.quantile(sigmas, np.linspace(0, 1, BINS + 1)))
    edges = np.array([edges[0], edges[0]]) if len(edges) == 1 else edges
    cells = []
    for number, (low, high) in enumerate(pairwise(edges)):
        top = math.inf if number == len(edges) - 2 else high

        def squares(name: str, low: float = low, top: float = top) -> Terms:  # where sigma is in the bin
            def terms(track: Track) -> tuple[float, float]:
                pairs = zip(track.values(name), track.values("sigma"), strict=True)
                inside = [value**2 for value, sigma in pairs if low <= sigma < top]
                return sum(inside), len(inside)

            return terms

        sigma = quotient(found, squares("sigma"), seed)
        error = quotient(found, squares("error"), seed)
        if sigma is None or error is None:
            continue
        cells.append(
            estimate_cell(f"sigma {sigma.value:.2f} rad", label, RELIABILITY, None, error, runs=runs)
        )
        ends = [error.value if end is None else end for end in (error.low, error.high)]
        axes.errorbar(
            sigma.value, error.value, yerr=[[max(0.0, error.value - ends[0])], [max(0.0, ends[1] - error.value)]],
            fmt="o", markersize=3.5, color=colour, linewidth=1.0, capsize=2,
        )  # fmt: skip
    return cells


def _diagonal(axes: Axes) -> None:
    axes.plot([0.05, 3.0], [0.05, 3.0], color=PAPER, linewidth=0.9, linestyle="--")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_title("Reliability of sigma")
    axes.set_xlabel("sigma (rad)")
    axes.set_ylabel("RMS error there (rad)")
    axes.grid(axis="x", color="#e4e6ea")
