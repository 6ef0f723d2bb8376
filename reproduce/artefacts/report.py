"""report/index.html: one self-contained page with every table, figure and claim, and how far each agent was trained."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from reproduce import provenance
from reproduce.artefacts.film import episodes, film_of
from reproduce.cells import Cell, percent, read_cells
from reproduce.files import read_csv, read_yaml
from reproduce.results import Results
from reproduce.style import short
from tactile_kit.evaluation.failures import KINDS
from tactile_kit.evaluation.rows import read_rows

PAPER_AGENTS = {
    "oracle": "7 to 11 hours",
    "tactile": "about 60 hours",
}  # paper, Sec. II-G: 4096 environments, one GPU
BARELY = 1_000_000  # environment steps: a few minutes of the paper's 4096 environments


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: the HTML page. Tables and figures are taken from beside it."""
    import jinja2

    from reproduce.files import write_atomic

    folder = Path(__file__).parent
    loader = jinja2.FileSystemLoader(folder)
    environment = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"percent": percent, "short": short, "cell": cell_text}
    page = environment.get_template("report.html.jinja").render(**content(results, outputs[0].parents[1]))
    write_atomic(outputs[0], page)


def content(results: Results, out: Path) -> dict[str, Any]:
    """What the page shows, as plain data."""
    texts = read_yaml(Path(__file__).parents[1] / "paper_values" / "report.yaml")
    claims = read_csv(out / "claims.csv")
    agents = [provenance.agent(results, name, out) for name in results.content["runs"]]
    missing = [agent["name"] for agent in agents if not agent["there"]]
    there = [agent for agent in agents if agent["there"]]
    benchmark = [agent for agent in there if agent["evaluated"]]
    tables = [
        {**text, "cells": read_cells(out / "tables" / f"{text['name']}.csv")} for text in texts["tables"]
    ]
    for table in tables:
        table["rows"] = _by_row(table["cells"])
    there_below = provenance.reached(tables[0]["cells"])
    figures = []
    for text in texts["figures"]:
        cells = read_cells(out / "figures" / f"{text['name']}.csv")
        image, width = _image(out / "figures" / text["name"])
        figures.append({**text, "cells": cells, "image": image, "width": width})
    return {
        "scale": results.scale,
        "description": results.content["description"],
        "source": results.content["source"],
        "agents": agents,
        "missing": provenance.missing_by_role(results, missing),
        "reached": there_below[0],
        "below": there_below[1],
        "classes": [row.lower() for row in tables[0]["rows"]],
        "numbers": {
            v: [c["number"] for c in claims if c["verdict"] == v] for v in ("reproduced", "not reproduced")
        },
        "differences": provenance.differences(),
        "most_steps": max((agent["steps"] for agent in benchmark), default=0),
        "barely": [agent["name"] for agent in benchmark if agent["steps"] < BARELY],
        "barely_steps": BARELY,
        "evaluated": len(benchmark),
        "claims": claims,
        "counts": {
            v: sum(c["verdict"] == v for c in claims)
            for v in ("reproduced", "not reproduced", "not measured")
        },
        "tables": tables,
        "figures": figures,
        "film": _film(out / "report" / "film.csv"),
        "failed": _failed(results.content["films"]),
        "paper_agents": PAPER_AGENTS,
        "episodes": _episodes(results),
    }


def _episodes(results: Results) -> int:
    return sum(len(read_rows(file)) for file in results.content["episodes"].values() if file is not None)


def _by_row(cells: Sequence[Cell]) -> dict[str, list[Cell]]:
    rows: dict[str, list[Cell]] = {}
    for cell in cells:
        rows.setdefault(cell.row, []).append(cell)
    return rows


def _film(table: Path) -> dict[str, Any] | None:
    """The film as a data URI, with what happens in it; None where nothing was filmed."""
    shown = episodes(table)
    if not shown:
        return None
    return {"address": _video(film_of(table)), "episodes": shown, "agent": shown[0]["agent"]}


def _failed(files: Sequence[str]) -> list[dict[str, str]]:
    """Films of failures, each with its row of the table beside them and its address."""
    if not files:
        return []
    return [
        row | {"words": KINDS[row["kind"]], "address": _video(Path(files[0]).parent / row["film"])}
        for row in read_csv(Path(files[0]))
    ]


def _video(file: Path) -> str:
    return f"data:video/mp4;base64,{base64.b64encode(file.read_bytes()).decode()}"


def _image(stem: Path) -> tuple[str, int]:
    """The figure as a data URI (PNG where the SVG is large), and its width in pixels as printed."""
    svg, png = stem.with_suffix(".svg").read_bytes(), stem.with_suffix(".png").read_bytes()
    kind, data = ("svg+xml", svg) if len(svg) < 600_000 else ("png", png)
    printed = re.search(rb'<svg[^>]* width="([0-9.]+)pt"', svg)
    width = round(float(printed.group(1)) * 96 / 72) if printed else 640
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}", width


def cell_text(cell: Cell, value: float | None = None) -> str:
    """A number of the cell in its own unit: rates as 0.97, changes as +3.0 %, angles as 1.20 rad. Default: ours."""
    if value is None:
        value = cell.ours
    if value is None:
        return cell.status
    if cell.quantity.startswith("relative"):
        return f"{100 * value:+.1f} %"
    if "(rad)" in cell.quantity:
        return f"{value:.2f} rad"
    if "(m)" in cell.quantity:
        return f"{1000 * value:.1f} mm"
    if "(s)" in cell.quantity:
        return f"{value:.1f} s"
    if "(µs)" in cell.quantity:
        return f"{value:.0f} µs"
    return f"{value:.2f}"
