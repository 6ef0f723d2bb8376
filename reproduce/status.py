"""How a scale stands: its runs with curves and hours, what its tables and figures lack, and how long that takes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

from reproduce.files import read_json, shown
from reproduce.inventory import NEEDS
from reproduce.output import columns
from reproduce.plan import FIGURES, TABLES, Plan, Run
from reproduce.prepare import describe, weight
from reproduce.provenance import hours_of
from reproduce.results import read_curve, steps_of
from reproduce.settings import run_settings
from reproduce.style import short

BARS = "▁▂▃▄▅▆▇█"
WIDTH = 24  # bars of a sparkline
SPEED = (
    20e6  # environment steps an hour of two cores, where no run here tells; results/benchmarks/recipe.json
)
EPISODES = 24_000  # evaluation episodes an hour of one core: `make reproduce`, two cores
ENOUGH = 0.5  # share of the scale's steps below which a run counts as cut short


def standing(plan: Plan) -> dict[str, Any]:
    """The scale as plain data: ``runs`` and ``artefacts``, hours on two cores."""
    runs = {run.name: _run(run, _target(plan, run)) for run in plan.runs}
    speed = {kind: _speed(runs.values(), kind) for kind in {run.kind for run in plan.runs}}
    for run in plan.runs:
        entry = runs[run.name]
        done = entry["steps"] is not None and entry["steps"] >= ENOUGH * _chain(plan, run)
        entry["chain"] = _chain(plan, run)
        entry["hours_to_go"] = 0.0 if done else max(entry["target"] - entry["own_steps"], 0) / speed[run.kind]
    return {
        "scale": describe(plan),
        "out": shown(plan.out),
        "runs": list(runs.values()),
        "artefacts": [_artefact(plan, name, runs) for name in (*TABLES, *FIGURES)],
    }


def _run(run: Run, target: int) -> dict[str, Any]:
    manifest = run.directory / "agent.json"
    found = read_json(manifest) if manifest.is_file() else None
    metrics, lock = run.directory / "metrics.jsonl", run.directory / ".lock"
    curve = read_curve(run.name, metrics) if metrics.is_file() else None
    return {
        "name": run.name,
        "role": run.role,
        "kind": run.kind,
        "target": target,
        "own_steps": int(found["steps"]) if found else 0,
        "own_hours": float(found["hours"]) if found else 0.0,
        "steps": steps_of(found) if found else None,
        "hours": round(hours_of(found), 3) if found else None,
        "curve": list(curve.success) if curve else [],
        "at_work": lock.read_text(encoding="utf-8").strip() if lock.is_file() else "",
    }


def _target(plan: Plan, run: Run) -> int:
    return int(run_settings(plan, run)["steps"])


def _chain(plan: Plan, run: Run) -> int:
    """Steps of the scale behind a run: its own and those it starts from."""
    before = [one for one in plan.runs if one.name == run.warm_start]
    return _target(plan, run) + sum(_chain(plan, one) for one in before)


def _speed(runs: Iterable[dict[str, Any]], kind: str) -> float:
    """Steps an hour of the fastest long run of that kind; older ones were slower."""
    long = [run for run in runs if run["kind"] == kind and run["own_steps"] >= 1e6 and run["own_hours"] > 0]
    return max((run["own_steps"] / run["own_hours"] for run in long), default=SPEED)


def _artefact(plan: Plan, name: str, runs: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """What a table or figure lacks: runs that are not there or were cut short, and episodes of those that are."""
    pairs, curves = NEEDS[name]
    mine = [
        runs[run.name]
        for run in plan.runs
        if (curves and run.kind == "oracle" and run.curves) or _evaluated(plan, run, pairs)
    ]
    episodes, count = _episodes(plan, pairs)
    return {
        "name": name,
        "of": len(mine),
        "missing": [run["name"] for run in mine if run["steps"] is None],
        "short": [run["name"] for run in mine if run["steps"] is not None and run["hours_to_go"] > 0],
        "episodes": episodes,
        "hours": round(sum(run["hours_to_go"] for run in mine) + count / EPISODES / 2, 2),
    }


def _evaluated(plan: Plan, run: Run, pairs: Sequence[tuple[str, str]]) -> bool:
    return any(one.run is run and (run.role, one.group.name) in pairs for one in plan.evaluations)


def _episodes(plan: Plan, pairs: Sequence[tuple[str, str]]) -> tuple[list[str], int]:
    """Episode files that are not there, and how many episodes those are that the pipeline can make."""
    missing, count = [], 0
    for role, evaluation in pairs:
        made = [one for one in plan.evaluations if (one.run.role, one.group.name) == (role, evaluation)]
        for one in made:
            if not one.file.is_file():
                missing.append(one.name)
                count += weight(one)
        found = list(plan.out.glob(f"episodes/{role}*/{evaluation}.csv"))
        if not made and not found:
            missing.append(f"{role}/{evaluation}")
    return missing, count


def sparkline(values: Sequence[float], width: int = WIDTH) -> str:
    """Numbers in [0, 1] as bars; more than ``width`` are averaged."""
    if not values:
        return ""
    edges = [round(len(values) * at / min(width, len(values))) for at in range(min(width, len(values)) + 1)]
    means = [sum(values[a:b]) / (b - a) for a, b in pairwise(edges)]
    return "".join(BARS[min(int(mean * len(BARS)), len(BARS) - 1)] for mean in means)


def text(found: dict[str, Any]) -> str:
    """The same for people."""
    there = [run for run in found["runs"] if run["steps"] is not None or run["curve"] or run["at_work"]]
    lines = [("run", "steps", "of", "hours", "success", "")]
    for run in there:
        lines.append(
            (
                run["name"],
                short(run["steps"]) if run["steps"] is not None else "-",
                short(run["chain"]),
                f"{run['hours']:.2f}" if run["hours"] is not None else "-",
                f"{run['curve'][-1]:.2f}" if run["curve"] else "-",
                sparkline(run["curve"]).ljust(WIDTH)
                + (f"  {run['at_work']} works here" if run["at_work"] else ""),
            )
        )
    said = [found["scale"], "", *columns(lines, left=(0, 5)), ""]
    said.append(
        "steps and hours with those a run started from; success and curve: its own, exploring, in training"
    )
    return "\n".join(
        [*said, "", *columns([(one["name"], _lacks(one)) for one in found["artefacts"]], left=(0, 1))]
    )


def _lacks(artefact: dict[str, Any]) -> str:
    parts = []
    for key, what in (("missing", "missing"), ("short", "cut short"), ("episodes", "episode files missing")):
        if names := artefact[key]:
            of = f" of {artefact['of']} runs" if key == "missing" else ""
            parts.append(f"{len(names)}{of} {what}: {', '.join(names[:3])}{' ...' if len(names) > 3 else ''}")
    if not parts:
        return "complete"
    return f"{'; '.join(parts)}; {artefact['hours']:.1f} h" if artefact["hours"] else "; ".join(parts)
