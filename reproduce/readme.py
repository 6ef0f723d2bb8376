"""Writes the README's lead and table of results from the tables: ``python -m reproduce.readme README.md results``."""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from pathlib import Path

from reproduce.cells import Cell, read_cells
from reproduce.errors import ReproduceError
from reproduce.files import read_json, write_atomic
from reproduce.provenance import hours_of, reached

BEGIN = "<!-- results: written by `make docs` from results/, not by hand -->"
END = "<!-- /results -->"
LEAD_BEGIN, LEAD_END = "<!-- lead: written by `make docs` -->", "<!-- /lead -->"
AGENT = "Finger cell"  # the column of the best agent that is told nothing but what it feels
LIKE = "Estimator VecBPS"  # the paper's agent that it stands beside


def _read(path: Path) -> list[dict[str, str]]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))
    except FileNotFoundError:
        raise ReproduceError(f"{path}: not there; make it with `make reproduce`") from None


def _steps(text: str) -> str:
    """``250000`` as ``250 k steps``."""
    if not text.isdigit():
        return text or "missing"
    steps = int(text)
    return f"{steps / 1e6:.3g} M steps" if steps >= 1e6 else f"{steps / 1e3:.3g} k steps"


def _trained(cells: list[dict[str, str]]) -> str:
    """What stands behind a column: steps of training, or what there is in place of it."""
    measured = [cell for cell in cells if cell["status"] == "measured"]
    return _steps(measured[0]["steps_trained"] or measured[0]["note"]) if measured else "missing"


def _rate(cell: dict[str, str]) -> str:
    paper = f" (paper {float(cell['paper']):.2f})" if cell["paper"] else ""
    if cell["status"] != "measured":
        return f"missing{paper}"
    ours, low, high = (float(cell[name]) for name in ("ours", "low", "high"))
    return f"**{ours:.2f}** [{low:.2f}, {high:.2f}]{paper}"


def block(results: Path) -> str:
    """The markdown between the README's markers, from ``tables/table1.csv`` and ``claims.csv``."""
    cells = _read(results / "tables" / "table1.csv")
    rows = list(dict.fromkeys(cell["row"] for cell in cells))
    columns = list(dict.fromkeys(cell["column"] for cell in cells))
    place = {(cell["row"], cell["column"]): cell for cell in cells}
    trained = [_trained([place[row, column] for row in rows]) for column in columns]
    lines = [
        "Table I, success rate (final angle below 0.4 rad after 10 s, drops fail), ours with its 95 % interval",
        "beside the paper's. **The shipped agents are trained for less than the paper's**: those saw 4096",
        "environments for hours on a GPU, ours the steps of the last row on two CPU cores. So the numbers say how far",
        "these agents are, not how far the method goes. The last three columns are not in the paper. The finger cell",
        "is our own estimator, whose basis points move with the fingers. The Kalman filter stands in for the estimator",
        "of VecBPS, same policy, same episodes ([docs/kalman.md](docs/kalman.md)). The planner knows the true state,",
        "tries its moves in a copy of the simulator, and was not trained",
        "([docs/planner.md](docs/planner.md)).",
        "",
        "| objects | " + " | ".join(columns) + " |",
        "|---|" + "---|" * len(columns),
    ]
    for row in rows:
        lines.append(f"| {row} | " + " | ".join(_rate(place[row, column]) for column in columns) + " |")
    counts = [sum(int(place[row, column]["n"]) for row in rows) for column in columns]
    lines.append("| episodes | " + " | ".join(map(str, counts)) + " |")
    lines.append("| trained for | " + " | ".join(trained) + " |")
    verdicts = [claim["verdict"] for claim in _read(results / "claims.csv")]
    tally = ", ".join(f"{verdicts.count(name)} {name}" for name in dict.fromkeys(verdicts))
    lines += [
        "",
        f"Of the paper's {len(verdicts)} claims: {tally}. Each with its figures: `results/claims.csv` and the report.",
    ]
    return "\n".join(lines)


def lead(results: Path) -> str:
    """The result in a sentence, and what it cost, from the same files and the agents' manifests."""
    cells = read_cells(results / "tables" / "table1.csv")
    there, _ = reached(cells)
    oracles = [
        name
        for name in _columns(cells)
        if name.startswith("Oracle") and any(t.startswith(name) for t in there)
    ]
    mine = [cell for cell in cells if cell.column == AGENT]
    rates = [cell.paper for cell in cells if cell.column == LIKE and cell.paper is not None]
    if not mine or any(cell.successes is None for cell in mine) or not rates:
        return "No agent that only feels has been evaluated on every class of Table I yet."
    count = sum(cell.n for cell in mine)
    rate = sum(cell.successes or 0 for cell in mine) / count
    said = f"**By touch alone the hand turns the object to its goal in {100 * rate:.0f} % of {count} episodes"
    said += f" (the paper's: {100 * min(rates):.0f} to {100 * max(rates):.0f} % by class of objects)"
    hours = _hours(results, mine[0].runs)
    if oracles:
        names = " and ".join(name.removeprefix("Oracle ") for name in oracles)
        said += f", and agents that are told the pose ({names}) reach the paper's rates"
    cost = (
        f"; the trainings behind it took {hours:.1f} hours on two CPU cores, without a GPU" if hours else ""
    )
    return f"{said}{cost}.**"


def _columns(cells: Sequence[Cell]) -> list[str]:
    return list(dict.fromkeys(cell.column for cell in cells))


def _hours(results: Path, run: str) -> float:
    """Hours behind a run, with those of all it started from; 0 where nobody wrote them down."""
    manifest = results / "agents" / run / "agent.json"
    return hours_of(read_json(manifest)) if manifest.is_file() else 0.0


def write(readme: Path, results: Path) -> None:
    """Replace the blocks in ``readme``. Raises ReproduceError where the markers are missing."""
    text = readme.read_text(encoding="utf-8")
    for begin, end, made in ((BEGIN, END, block), (LEAD_BEGIN, LEAD_END, lead)):
        if text.count(begin) != 1 or text.count(end) != 1:
            raise ReproduceError(f"{readme}: needs the lines {begin!r} and {end!r} once each")
        before, _, rest = text.partition(begin)
        text = f"{before}{begin}\n{made(results)}\n{end}{rest.partition(end)[2]}"
    write_atomic(readme, text)


def main(args: Sequence[str] | None = None) -> int:
    """``README.md results``."""
    readme, results = map(Path, sys.argv[1:] if args is None else args)
    write(readme, results)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
