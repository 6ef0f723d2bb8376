"""How all figures look and how they are saved: same data, same bytes. matplotlib is imported on use."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from reproduce.files import write_atomic

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMN, PAGE = 3.5, 7.16  # inch: a column of the paper's two, and both; so text is as large as it says
# Okabe and Ito's colours, which colour-blind readers tell apart
ORACLE, TACTILE, ELSEWHERE = "#0072b2", "#d55e00", "#cc79a7"
GREY, SOFT, PALE, PAPER = "#8a8f98", "#555b66", "#d0d4db", "#111111"
LINES = (  # colours of encodings in the order of their registry, again from the start when there are more
    TACTILE, "#e69f00", ORACLE, ELSEWHERE, "#009e73", "#56b4e9", PAPER, GREY,
)  # fmt: skip
SIGNS = 19  # of small print, an inch
_SETTINGS = {
    "svg.hashsalt": "tactile_kit",  # element ids that don't change from run to run
    "font.family": "DejaVu Sans",  # comes with matplotlib, so the same everywhere
    "font.size": 7.5,
    "axes.titlesize": 8,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 7,
    "axes.titleweight": "bold",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "axes.axisbelow": True,
    "grid.color": "#e4e6ea",
    "legend.frameon": False,
    "figure.dpi": 100,
    "savefig.dpi": 240,
}


def line_of(encoding: str) -> tuple[str, str]:
    """(colour, label) of an encoding in the learning curves."""
    from tactile_kit.shape import kind_of, names

    return LINES[names().index(encoding) % len(LINES)], kind_of(encoding).label


def figure(width: float, height: float, columns: int = 1, **options: object) -> tuple[Figure, Sequence[Axes]]:
    """A figure of that size (inch; ``COLUMN`` or ``PAGE`` wide) with a row of axes."""
    import matplotlib.pyplot as plt

    reset()
    plt.rcParams.update(_SETTINGS)
    made, axes = plt.subplots(
        1, columns, figsize=(width, height), squeeze=False, layout="constrained", **options
    )
    return made, list(axes[0])


def reset() -> None:
    """matplotlib as it comes, without a display, whatever was drawn before or stands in a user's matplotlibrc."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams.update(matplotlib.rcParamsDefault | {"backend": "Agg"})


def save(made: Figure, outputs: Sequence[Path]) -> None:
    """Writes the figure to those of ``outputs`` that are pictures; no dates, versions or random ids in them."""
    import matplotlib.pyplot as plt

    for path in outputs:
        if path.suffix not in (".png", ".svg"):
            continue
        buffer = io.BytesIO()
        metadata = {"Date": None, "Creator": None} if path.suffix == ".svg" else {"Software": None}
        made.savefig(buffer, format=path.suffix[1:], metadata=metadata)
        write_atomic(path, buffer.getvalue())
    plt.close(made)


def footnote(made: Figure, text: str) -> None:
    """Small print below the axes, broken to the figure's width; constrained layout leaves room for it."""
    lines = textwrap.fill(text, int(SIGNS * made.get_figwidth()))
    made.supxlabel(lines, fontsize=6.5, color=SOFT, x=0.01, ha="left")


def say_missing(axes: Axes, text: str) -> None:
    """Empty axes say in words what is missing, and draw no frame, scale or grid that would look like a result."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=SOFT, fontsize=7.5)


def missing_bar(axes: Axes, x: float, text: str = "missing") -> None:
    """The word where a bar would stand had the run been made; nothing that has a height."""
    axes.text(x, 0.02, text, rotation=90, ha="center", va="bottom", fontsize=5.5, color=SOFT)


def steps_text(steps: Sequence[int]) -> str:
    """Environment steps trained, in words: '35 k steps', '1.2 M steps', or a range."""
    if not steps:
        return "steps unknown"
    low, high = short(min(steps)), short(max(steps))
    return f"{low} steps" if low == high else f"{low} to {high} steps"


def short(number: int) -> str:
    """12345 -> '12.3 k'."""
    for size, unit in ((10**9, "G"), (10**6, "M"), (10**3, "k")):
        if number >= size:
            return f"{number / size:.3g} {unit}"
    return str(number)
