"""Fig. 6 of the paper: distributions of the final angle, one violin an object, oracle (left) and tactile (right)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from reproduce.cells import Cell, empty_cell, estimate_cell, paper_values, range_of, write_cells
from reproduce.inventory import ORACLE, TACTILE
from reproduce.labels import object_label, paper_objects
from reproduce.results import Results
from reproduce.style import GREY, PAGE, PAPER, SOFT, figure, footnote, save, steps_text
from reproduce.style import ORACLE as BLUE
from reproduce.style import TACTILE as ORANGE
from tactile_kit.evaluation.rows import SUCCESS_ANGLE, EpisodeRow
from tactile_kit.evaluation.summary import final_angles, group, mean_final_angle
from tactile_kit.evaluation.summary import share as rate_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BANDWIDTH = 0.06  # rad, of the Gaussian kernel
HALF = 0.42  # width of half a violin at its widest
WIDEST = 2.5  # 1/rad: the density that fills a half, at least; 95 % within 0.4 rad. Weak agents look thin.
THIN = 0.02  # 1/rad: less is no episode, only a tail of the kernel
GAP = 0.012  # between the halves and the middle
TOP = 1.72  # where what lies beyond the cut-off is drawn


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: PNG, SVG and a CSV of what each half shows."""
    cutoff = paper_values("violin")["cutoff"]
    made, (axes,) = figure(PAGE, 3.0)
    cells: list[Cell] = []
    objects = paper_objects()
    agents = ((ORACLE, "Oracle VecBPS", BLUE, -1), (TACTILE, "Tactile VecBPS", ORANGE, 1))
    everyone = {role: by_object(results.rows(role, "nominal") or ()) for role, *_ in agents}
    widest = max(
        [WIDEST, *(shape(rows, cutoff)[1].max() for found in everyone.values() for rows in found.values())]
    )
    for role, label, colour, side in agents:
        rows = everyone[role]
        runs = results.evaluated(role, "nominal")
        steps = results.steps_trained(runs)
        said = f"{label}, {steps_text(steps)}" if rows else f"{label}: missing"
        axes.fill_between([], [], [], color=colour, alpha=0.75, linewidth=0, label=said)
        for item in objects:
            mine = rows.get(item.id, [])
            cells += _cells(mine, object_label(item), label, cutoff, runs, steps, results.seed)
            if mine:
                half_violin(axes, item.id, side, mine, cutoff, colour, widest)
            else:
                axes.text(
                    item.id + 0.2 * side,
                    0.75,
                    "missing",
                    rotation=90,
                    ha="center",
                    va="center",
                    fontsize=5.5,
                    color=SOFT,
                )
    axes.axhline(SUCCESS_ANGLE, color=PAPER, linewidth=0.7, linestyle="--")
    axes.text(len(objects) - 0.45, SUCCESS_ANGLE, " success", va="center", fontsize=6.5)
    axes.axhline(cutoff, color=GREY, linewidth=0.6)
    axes.set_xticks(
        [item.id for item in objects], [object_label(item, True) for item in objects], fontsize=6.5
    )
    axes.set_yticks([0, 0.4, 0.8, 1.2, 1.5, TOP], ["0", "0.4", "0.8", "1.2", "1.5", "> 1.5\nor drop"])
    axes.set_ylim(0, TOP + 0.13)
    axes.set_xlim(-0.6, len(objects) - 0.4)
    axes.set_ylabel("final angle to the goal (rad)")
    made.legend(loc="outside upper right", ncols=2)
    footnote(
        made,
        f"Scale {results.scale}. {range_of(cells)} episodes a half violin (the paper: 1536). Lumps at the top: angles"
        " over 1.5 rad and drops, with their share in %.",
    )
    save(made, outputs)
    write_cells(outputs[2], cells)


def lost(row: EpisodeRow, cutoff: float) -> bool:
    """Whether the episode belongs to the lump at the top."""
    return row.drop or row.theta is None or row.theta > cutoff


def by_object(rows: Sequence[EpisodeRow]) -> dict[int, list[EpisodeRow]]:
    return group(rows, lambda row: row.object_id)


def shape(rows: Sequence[EpisodeRow], cutoff: float) -> tuple[np.ndarray, np.ndarray, int]:
    """(grid (151,) rad, density (151,) 1/rad, episodes below the cut-off). The area is the share of such episodes."""
    kept = final_angles([row for row in rows if not lost(row, cutoff)])
    grid = np.linspace(0.0, cutoff, 151)
    return grid, density_of(kept, grid) * (len(kept) / len(rows)), len(kept)


def half_violin(
    axes: Axes, x: float, side: int, rows: Sequence[EpisodeRow], cutoff: float, colour: str, widest: float
) -> None:
    """One half. All halves share one scale, so that bulges can be compared; the lump's width is its share."""
    grid, density, kept = shape(rows, cutoff)
    # An outline keeps the thin half of a weak agent visible; where no episode ends nothing is drawn.
    drawn = density > THIN
    edge = x + side * (GAP + density / widest * HALF)
    axes.fill_betweenx(grid, x + side * GAP, edge, where=drawn, color=colour, alpha=0.85, linewidth=0.5)
    share = 1.0 - kept / len(rows)
    lump = np.linspace(TOP - 0.06, TOP + 0.06, 25)
    round_off = np.sqrt(np.maximum(0.0, 1 - ((lump - TOP) / 0.06) ** 2))
    axes.fill_betweenx(lump, x, x + side * round_off * share * HALF, color=colour, alpha=0.75, linewidth=0)
    axes.text(
        x + side * 0.22,
        TOP + 0.065,
        f"{100 * share:.0f}",
        ha="center",
        va="bottom",
        fontsize=5.5,
        color=colour,
    )


def density_of(angles: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Gaussian kernel density (1/rad) on ``grid``, mirrored at 0 so that no mass leaves the range of angles."""
    if len(angles) == 0:
        return np.zeros_like(grid)
    both = np.concatenate([angles, -angles])
    z = (grid[:, None] - both) / BANDWIDTH
    return np.exp(-0.5 * z * z).sum(1) / (len(angles) * BANDWIDTH * np.sqrt(2 * np.pi))


def _cells(
    rows: Sequence[EpisodeRow],
    row: str,
    column: str,
    cutoff: float,
    runs: Sequence[str],
    steps: Sequence[int],
    seed: int,
) -> list[Cell]:
    angle, share = "mean final angle (rad)", "share over 1.5 rad or dropped"
    if not any(r.theta is not None for r in rows):
        why = "not evaluated" if not rows else "no episode without a fault"
        return [empty_cell(row, column, angle, None, why), empty_cell(row, column, share, None, why)]
    away = rate_of(sum(lost(r, cutoff) for r in rows), len(rows))
    return [
        estimate_cell(row, column, angle, None, mean_final_angle(rows, seed), runs=runs, steps=steps),
        estimate_cell(row, column, share, None, away, runs=runs, steps=steps),
    ]
