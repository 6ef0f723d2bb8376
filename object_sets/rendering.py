"""The contact sheet: every object of a set on one page, with id, name and size (figure F1)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from object_sets.errors import ObjectSetError
from object_sets.objects import Object
from object_sets.sets import SETS, load

COLORS = {"geometric8": (0.36, 0.60, 0.84), "ood": (0.95, 0.66, 0.34), "complex": (0.52, 0.74, 0.45)}
PLAIN = (0.66, 0.66, 0.72)
LABELS = {"geometric8": "Geometric 8", "ood": "out of distribution", "complex": "complex (stand-ins)"}


def render_sheet(
    objects: Sequence[Object],
    path_png: str | Path,
    path_svg: str | Path | None = None,
    *,
    columns: int | None = None,
    pixels: int = 320,
) -> None:
    """Draw objects side by side, all to the same scale, and write PNG and, when asked for, SVG.

    Args:
        objects: at least one; the paper's objects are coloured by set.
        path_png, path_svg: files to write; folders are made.
        columns: pictures a row; by default few empty places on a page between square and 3:2.
        pixels: side of each picture.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    from object_sets.raster import VIEW, render, view

    if len(objects) == 0:
        raise ObjectSetError("render_sheet: no objects; at least one is needed")
    columns = columns or _columns(len(objects))
    rows = -(-len(objects) // columns)
    width = 2.1 * max(float(np.abs((item.vertices @ view(*VIEW).T)[:, :2]).max()) for item in objects)
    figure = Figure(figsize=(1.7 * columns, 1.95 * rows + 0.35), dpi=200)
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    used: dict[str, tuple[float, float, float]] = {}
    for axis in axes:
        axis.set_axis_off()
    for axis, item in zip(axes, objects, strict=False):
        group = _group(item)
        color = COLORS[group] if group else PLAIN
        if group:
            used[LABELS[group]] = color
        axis.imshow(render(item.vertices, item.faces, color, pixels, width), interpolation="antialiased")
        size = " × ".join(f"{1000 * side:.0f}" for side in item.extents)
        axis.set_title(f"{item.id}  {item.name.replace('_', ' ')}", fontsize=8, pad=1)
        axis.text(
            0.5,
            -0.02,
            f"{size} mm",
            transform=axis.transAxes,
            ha="center",
            va="top",
            fontsize=6,
            color="0.35",
        )
    figure.subplots_adjust(
        left=0.01, right=0.99, top=1.0 - 0.3 / figure.get_figheight(), bottom=0.09, wspace=0.02
    )
    if used:
        handles = [Patch(color=color, label=label) for label, color in used.items()]
        figure.legend(handles=handles, loc="lower center", ncols=len(handles), fontsize=7, frameon=False)
    for path in (path_png, path_svg):
        if path is not None:
            target = Path(path)
            target.parent.mkdir(parents=True, exist_ok=True)
            # no date, so that the same objects give the same file
            clean = {"Date": None} if target.suffix == ".svg" else {"Software": None}
            with rc_context({"svg.hashsalt": "object_sets"}):
                figure.savefig(target, metadata=clean)


def _columns(count: int) -> int:
    """Columns of a page between square and 3:2, with the fewest empty places."""
    root = np.sqrt(count)
    return min(
        range(int(np.ceil(root)), int(1.5 * root) + 2), key=lambda columns: (-count % columns, -columns)
    )


def _group(item: Object) -> str | None:
    """The paper's set an object is in; objects of other sets have none."""
    authored = load("all")
    if item.id < len(authored) and item.name == authored[item.id].name:
        return next(group for group in COLORS if item.id in SETS[group])
    return None
