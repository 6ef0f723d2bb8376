"""Fig. 9 of the paper: success against the extent furthest from the median, told the right or a median mesh."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import randomization
from reproduce.cells import MEASURED, Cell, paper_values, rate_cell, write_cells
from reproduce.inventory import TACTILE
from reproduce.results import Results
from reproduce.style import COLUMN, GREY, figure, footnote, save, say_missing, steps_text
from reproduce.style import ORACLE as BLUE
from reproduce.style import TACTILE as ORANGE
from tactile_kit.evaluation.rows import EpisodeRow
from tactile_kit.evaluation.summary import group

LINES = (
    ("extent-true", "correct mesh", BLUE, "o"),
    ("extent-fixed", "fixed median mesh", ORANGE, "^"),
)
FIT = 256  # samples a line must have, over the whole range, before a polynomial of degree 4 says anything
WIDTH = 0.002  # m, standard deviation of the smoother's weights
NEIGHBOURS = 4  # samples that a local mean must rest on
REPLICATES = 400  # of the bootstrap behind the band
BINS = 6  # of the furthest extent, for the table beside the figure


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: PNG, SVG and a CSV of success by bins of the furthest extent."""
    values = paper_values("extent")
    cells: list[Cell] = []
    made, (axes,) = figure(COLUMN, 3.2)
    episodes = []
    fitted = False
    for evaluation, label, colour, marker in LINES:
        rows, runs = results.rows(TACTILE, evaluation), results.evaluated(TACTILE, evaluation)
        steps = results.steps_trained(runs)
        cells += bin_cells(rows, label, values["range"], runs, steps)
        if rows is None:
            axes.plot([], [], color=colour, marker=marker, label=f"{label}: missing")
            continue
        extents, rates, counts = samples(rows)
        episodes += list(counts)
        axes.scatter(100 * extents, rates, s=9, color=colour, marker=marker, alpha=0.55, linewidths=0)
        name = f"{label}, {len(rates)} samples"
        mine = [cell for cell in cells if cell.column == label]
        measured = [cell for cell in mine if cell.status == MEASURED]
        enough = len(rates) >= FIT and len(measured) == len(mine)
        fit = polynomial(extents, rates, values["degree"]) if enough else None
        if fit is not None:
            fitted = True
            x = np.linspace(extents.min(), extents.max(), 200)
            axes.plot(100 * x, np.clip(fit(x), 0, 1), color=colour, linewidth=1.3, label=name)
            continue
        # Points only would leave the eye to guess: a local mean, with its band, where there are samples to take it of.
        for x, mean, low, high in smooth(extents, rates, results.seed):
            axes.fill_between(100 * x, low, high, color=colour, alpha=0.18, linewidth=0)
            axes.plot(100 * x, mean, color=colour, linewidth=1.3)
        axes.plot([], [], color=colour, marker=marker, label=name)
    if not episodes:
        say_missing(axes, "missing: the tactile agent was not evaluated")
    lines = (
        "Lines: polynomials of degree 4."
        if fitted
        else f"Lines: local means with 95 % bands; no polynomial below {FIT} samples in all bins."
    )
    axes.axvline(100 * values["median"], color=GREY, linewidth=0.8, linestyle=":")
    axes.set_xlabel("extent furthest from the median (cm)")
    axes.set_ylabel("success rate")
    axes.set_xlim(100 * values["range"][0] - 0.1, 100 * values["range"][1] + 0.1)
    axes.set_ylim(-0.02, 1.02)
    made.legend(loc="outside upper center", ncols=1)
    least, most = (min(episodes), max(episodes)) if episodes else (0, 0)
    span = f"{least}" if least == most else f"{least} to {most}"
    trained = steps_text(results.steps_trained(results.run_names(TACTILE)))
    footnote(
        made,
        f"Scale {results.scale}; tactile VecBPS, {trained}. A sample: one object size, {span} episodes "
        f"(the paper: 120; 512 samples a line). {lines}",
    )
    save(made, outputs)
    write_cells(outputs[2], cells)


def samples(rows: Sequence[EpisodeRow]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(extents (S,) m, success rates (S,), episodes (S,) int): one sample an object, size and run."""
    groups = group(rows, lambda row: (row.agent, row.object_id, row.size)).values()
    return (
        np.array([members[0].furthest_extent for members in groups]),
        np.array([np.mean([row.success for row in members]) for members in groups]),
        np.array([len(members) for members in groups]),
    )


def polynomial(extents: np.ndarray, rates: np.ndarray, degree: int) -> np.polynomial.Polynomial | None:
    """Least-squares polynomial; None where there are too few different extents to determine one."""
    if len(np.unique(extents)) <= degree + 1:
        return None
    return np.polynomial.Polynomial.fit(extents, rates, degree)


Piece = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def smooth(extents: np.ndarray, rates: np.ndarray, seed: int) -> list[Piece]:
    """Local means of ``rates`` by Gaussian weights, with 95 % bands of a bootstrap over samples.

    Returns (extents m, means, lower, upper) of each stretch in which the weights (1 where a sample is) add up to
    ``NEIGHBOURS`` or more; gaps between the stretches are left open.
    """
    x = np.linspace(extents.min(), extents.max(), 161)
    weights = np.exp(-0.5 * ((x[:, None] - extents) / WIDTH) ** 2)
    resting = weights.sum(axis=1) >= NEIGHBOURS
    drawn = randomization.stream(seed, "bootstrap", "extent").integers(
        len(rates), size=(REPLICATES, len(rates))
    )
    counts = np.stack([np.bincount(chosen, minlength=len(rates)) for chosen in drawn])
    means = (weights @ (counts * rates).T) / np.maximum(weights @ counts.T, 1e-300)
    low, high = np.quantile(means, (0.025, 0.975), axis=1)
    mean = weights @ rates / np.maximum(weights.sum(axis=1), 1e-300)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], resting.astype(int), [0]])))
    return [(x[a:b], mean[a:b], low[a:b], high[a:b]) for a, b in edges.reshape(-1, 2)]


def bin_cells(
    rows: Sequence[EpisodeRow] | None,
    label: str,
    span: Sequence[float],
    runs: Sequence[str],
    steps: Sequence[int],
) -> list[Cell]:
    """Success rates by equal bins of the furthest extent."""
    edges = np.linspace(span[0], span[1], BINS + 1)
    cells = []
    for low, high in itertools.pairwise(edges):
        last = high == edges[-1]
        inside = [
            row
            for row in rows or ()
            if low <= row.furthest_extent < high or (last and row.furthest_extent >= high)
        ]
        name = f"{100 * low:.2f} to {100 * high:.2f} cm"
        why = "run not there" if rows is None else "no object size in this range"
        cells.append(rate_cell(name, label, None, inside, runs=runs, steps=steps, missing=why))
    return cells
