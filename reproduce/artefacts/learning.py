"""Fig. 5 of the paper: success rate of oracle agents during training, by shape encoding and object set."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import randomization
from reproduce.cells import Cell, empty_cell, estimate_cell, paper_values, write_cells
from reproduce.results import Curve, Results
from reproduce.style import PAGE, figure, footnote, line_of, save, say_missing, short
from tactile_kit.evaluation.intervals import stratified_bootstrap
from tactile_kit.evaluation.summary import Estimate

GRID = 200  # points a curve is drawn with
TAIL = 0.1  # the last tenth of training stands for "where the curve ends"
CURVES: dict[str, list[str]] = {panel["set"]: panel["lines"] for panel in paper_values("learning")["panels"]}


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: PNG, SVG and a CSV of where the curves end."""
    values = paper_values("learning")
    made, panels = figure(PAGE, 3.0, 3, sharey=True)
    cells: list[Cell] = []
    for axes, panel in zip(panels, values["panels"], strict=True):
        objects = panel["set"]
        missing = []
        longest = 0
        lines = results.lines(objects, panel["lines"])
        for line in lines:
            colour, label = line_of(line)
            curves = usable(results.curves(f"oracle-{line}-{objects}"))
            cells.append(_end_cell(objects, label, curves, results))
            if not curves:
                missing.append(label)
                continue
            steps, low, mean, high = band(curves)
            longest = max(longest, int(steps[-1]))
            axes.plot(steps, mean, color=colour, linewidth=1.4, label=f"{label} ({len(curves)})")
            if len(curves) > 1:
                axes.fill_between(steps, low, high, color=colour, alpha=0.18, linewidth=0)
        axes.set_title(panel["title"])
        axes.set_xlabel("environment steps")
        axes.set_ylim(-0.02, 1)  # a line at zero must not hide behind the axis
        axes.set_xlim(0, longest or 1)
        axes.locator_params(axis="x", nbins=5)
        axes.xaxis.set_major_formatter(lambda value, _: short(int(value)))
        if missing and len(missing) == len(lines):
            said = "\n".join(textwrap.wrap(", ".join(missing), 24))
            say_missing(axes, f"no run of this object set;\nmissing:\n{said}")
        else:
            title = "missing: " + ", ".join(missing) if missing else None
            place = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.2), "ncols": 3}
            axes.legend(
                fontsize=6.5, title=title, title_fontsize=6.5, columnspacing=0.8, handlelength=1.0, **place
            )
    panels[0].set_ylabel("success rate")
    footnote(
        made,
        f"Scale {results.scale}. Success without noise at full gravity, on goals held out (compiled physics), where a"
        " run measured that; else in training, smoothed. Line: mean over seeds (their number in brackets); band:"
        " smallest to largest seed. The paper shows three seeds a line, and its curves as a picture only.",
    )
    save(made, outputs)
    write_cells(outputs[2], cells)


def usable(curves: Sequence[Curve]) -> list[Curve]:
    """Those with two points or more: a line needs them."""
    return [curve for curve in curves if len(curve.steps) >= 2]


def band(curves: Sequence[Curve]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(steps, smallest, mean, largest), each (GRID,), over the steps all seeds have reached."""
    first = max(curve.steps[0] for curve in curves)
    last = min(curve.steps[-1] for curve in curves)
    steps = np.linspace(first, last, GRID)
    values = np.stack([np.interp(steps, curve.steps, curve.success) for curve in curves])
    return steps, values.min(0), values.mean(0), values.max(0)


def ends(curves: Sequence[Curve], last: int | None = None) -> np.ndarray:
    """(seeds,) mean success over the last tenth of the steps that all have reached (up to ``last``)."""
    last = min(curve.steps[-1] for curve in curves) if last is None else last
    grid = np.linspace((1 - TAIL) * last, last, 20)
    return np.array([np.interp(grid, curve.steps, curve.success).mean() for curve in curves])


def _end_cell(objects: str, label: str, curves: Sequence[Curve], results: Results) -> Cell:
    quantity = "success rate at the end of training"
    if not curves:
        return empty_cell(objects, label, quantity, None, "run not there", unit="seeds")
    values = ends(curves)
    low = high = None
    note = "one seed: no interval"
    if len(values) > 1:
        generator = randomization.stream(results.seed, "bootstrap", "learning", objects, label)
        low, high = (
            float(v) for v in stratified_bootstrap([values], lambda s: s[0].mean(), generator=generator)
        )
        note = f"smallest {values.min():.3f}, largest {values.max():.3f}"
    return estimate_cell(
        objects,
        label,
        quantity,
        None,
        Estimate(float(values.mean()), low, high, len(values)),
        unit="seeds",
        note=note,
        runs=[curve.run for curve in curves],
        steps=[curve.steps[-1] for curve in curves],
    )
