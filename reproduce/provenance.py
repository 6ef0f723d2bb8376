"""Where the report's numbers come from: what an agent cost with all it started from, its machine, what is missing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from reproduce.cells import MEASURED, Cell
from reproduce.files import read_json
from reproduce.results import Results, steps_of

CLOSE = 0.05  # a rate this far below the paper's still counts as reached, as in the claims


def hours_of(manifest: dict[str, Any]) -> float:
    """Hours behind an agent: its own and, as they were counted when it began, those of all it started from."""
    return float(manifest.get("hours", 0.0)) + float((manifest.get("warm_start") or {}).get("hours", 0.0))


def agent(results: Results, name: str, out: Path) -> dict[str, Any]:
    """What the report says of a run. ``config``: address of its settings seen from the page, empty where elsewhere."""
    manifest = results.manifest(name)
    evaluated = any(file and key.startswith(f"{name}/") for key, file in results.content["episodes"].items())
    said = {"name": name, "there": manifest is not None, "evaluated": evaluated}
    if manifest is None:
        return said
    directory = Path(results.content["runs"][name]["agent"]).parent
    record = directory / "run.json"
    start = read_json(record)["starts"][-1] if record.is_file() else {}
    machine = start.get("hardware", {})
    config = directory / "config.yaml"
    inside = config.is_file() and config.resolve().is_relative_to(out.resolve())
    return said | {
        "kind": manifest["kind"],
        "encoding": manifest["encoding"],
        "algorithm": str(manifest.get("algorithm", "")).upper(),
        "steps": steps_of(manifest),
        "own_steps": int(manifest["steps"]),
        "hours": hours_of(manifest),
        "own_hours": float(manifest.get("hours", 0.0)),
        "warm_start": (manifest.get("warm_start") or {}).get("from"),
        "date": start.get("time", "")[:10],
        "machine": f"{machine['processor']}, {machine['cores']} cores" if machine else "",
        "commit": (start.get("git") or "")[:10],
        "config": f"../{config.resolve().relative_to(out.resolve()).as_posix()}" if inside else "",
    }


def missing_by_role(results: Results, missing: Iterable[str]) -> dict[str, list[str]]:
    """Role -> the seeds that are not there, in the plan's order."""
    grouped: dict[str, list[str]] = {}
    for name in missing:
        role = results.content["runs"][name]["role"]
        grouped.setdefault(role, []).append(name.removeprefix(f"{role}-s"))
    return grouped


def reached(cells: Sequence[Cell]) -> tuple[list[str], list[str]]:
    """Table I's columns in words: those that reach the paper's rate in every class, and those that do not.

    Reached is a rate whose interval holds the paper's, or that is no more than ``CLOSE`` below it. Columns with a class
    missing, and those the paper has not, are in neither.
    """
    there: list[str] = []
    below: list[str] = []
    for column in dict.fromkeys(cell.column for cell in cells):
        mine = [cell for cell in cells if cell.column == column]
        if any(cell.status != MEASURED or cell.paper is None for cell in mine):
            continue
        ours = ", ".join(f"{cell.ours:.2f}" for cell in mine)
        paper = ", ".join(f"{cell.paper:.2f}" for cell in mine)
        good = all((cell.ours or 0) >= (cell.paper or 0) - CLOSE or _holds(cell) for cell in mine)
        (there if good else below).append(f"{column} {ours} (paper {paper})")
    return there, below


def _holds(cell: Cell) -> bool:
    return cell.low is not None and cell.high is not None and cell.low <= (cell.paper or 0) <= cell.high


def differences() -> list[dict[str, Any]]:
    """docs/differences.md as plain data: title, rows of its table (paper, here, why), points beside it.

    The package holds the page through a link, so that an installed one has it too.
    """
    text = (Path(__file__).parent / "paper_values" / "differences.md").read_text(encoding="utf-8")
    sections = []
    for part in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        title, _, body = part.partition("\n")
        lines = body.splitlines()
        rows = [
            [_plain(cell) for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")
        ]
        points = re.findall(r"^- (.*(?:\n  .*)*)", body, flags=re.MULTILINE)
        sections.append({"title": title, "rows": rows[2:], "points": [_plain(point) for point in points]})
    return sections


def _plain(markdown: str) -> str:
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", markdown)
    return " ".join(re.sub(r"[`*]", "", text).split())
