"""Bars with intervals, and the word where a run is missing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reproduce.cells import MEASURED, Cell
from reproduce.style import missing_bar

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def bar(axes: Axes, x: float, width: float, cell: Cell, colour: str) -> None:
    """The cell's success rate as a bar with its 95 % interval; the word where it is missing."""
    if cell.status != MEASURED or cell.ours is None or cell.low is None or cell.high is None:
        missing_bar(axes, x)
        return
    axes.bar(x, cell.ours, width, color=colour, zorder=2)
    errors = [[max(0.0, cell.ours - cell.low)], [max(0.0, cell.high - cell.ours)]]
    axes.errorbar(x, cell.ours, yerr=errors, color="#222222", linewidth=0.9, capsize=2, zorder=3)
    axes.text(
        x, min(cell.high, 0.97) + 0.012, f"{cell.ours:.2f}", ha="center", va="bottom", fontsize=6.5, zorder=4
    )
