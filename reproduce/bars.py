"""Bars with intervals, and the word where a run is missing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reproduce.cells import MEASURED, Cell
from reproduce.style import missing_bar

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TICKS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)


def bar(axes: Axes, x: float, width: float, cell: Cell, colour: str) -> None:
    """The cell's success rate as a bar with its 95 % interval; the word where it is missing."""
    if cell.status != MEASURED or cell.ours is None or cell.low is None or cell.high is None:
        missing_bar(axes, x)
        return
    axes.bar(x, cell.ours, width, color=colour, zorder=2)
    errors = [[max(0.0, cell.ours - cell.low)], [max(0.0, cell.high - cell.ours)]]
    axes.errorbar(x, cell.ours, yerr=errors, color="#222222", linewidth=0.7, capsize=1.5, zorder=3)
    said = f"{cell.ours:.2f}".removeprefix("0")
    axes.text(x, cell.high + 0.02, said, ha="center", va="bottom", fontsize=5.5, zorder=4)


def rates(axes: Axes) -> None:
    """The scale of success rates, with room for the number above a bar that reaches 1."""
    axes.set_ylim(0, 1.1)
    axes.set_yticks(TICKS)
