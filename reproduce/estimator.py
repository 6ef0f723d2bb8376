"""The estimator by itself: trained on the streams of an agent that does not learn, and measured against time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from reproduce.cells import paper_values
from reproduce.errors import ReproduceError
from tactile_kit.runs.config import RunConfig


def settings_of(agent: Path, steps: int, cell: str, closed_loop: bool, seed: int) -> RunConfig:
    """A run in which ``agent`` acts, told the truth or (``closed_loop``) the estimate, and its estimator learns.

    Raises ``ReproduceError`` where there is no agent.
    """
    if not (agent / "agent.json").is_file():
        raise ReproduceError(f"{agent}: no agent there (agent.json is missing)")
    from tactile_kit.agents.manifest import read_manifest

    task = read_manifest(agent).task
    estimator: dict[str, Any] = {"cell": cell, "loss": "pose" if cell == "fingers" else "likelihood"}
    changes = {
        "kind": "tactile",
        "warm_start": str(agent),
        "steps": steps,
        "seed": seed,
        "task": {name: task[name] for name in ("objects", "encoding", "action", "scaling", "variants")},
        "ppo": {"fixed_steps": steps},
        "estimator": estimator,
        "ecrl": {"rho_start": 0.0 if closed_loop else 1.0, "rho_step": 0.0},
    }
    return RunConfig.preset("tactile-compiled", changes)


def measure(agent: Path, objects: str, truth: bool, episodes: int, seed: int) -> list[dict[str, Any]]:
    """One row a class of Table I, and one over all: ``class`` and the figures of ``evaluation.estimates.Followed``."""
    from tactile_kit.agents.agent import load_agent
    from tactile_kit.evaluation.estimates import follow

    followed = follow(load_agent(agent), objects, truth=truth, episodes=episodes, seed=seed)
    classes = [(row["name"], row["ids"]) for row in paper_values("table1")["rows"]]
    everything = sorted(set(followed.object_id.tolist()))
    rows = [("All", everything), *((name, [i for i in ids if i in everything]) for name, ids in classes)]
    return [{"class": name, **followed.of(ids).figures()} for name, ids in rows if ids]


def table(rows: list[dict[str, Any]]) -> str:
    """The rows as people read them: mean and median error in rad."""
    lines = [f"{'':<12}{'n':>6}{'1 s':>14}{'2 s':>14}{'5 s':>14}{'10 s':>14}{'< 0.4':>8}{'error/sigma':>13}"]
    for row in rows:
        pairs = [
            f"{row[f'mean_{s}s']:.2f}/{row[f'median_{s}s']:.2f}" if f"mean_{s}s" in row else "-"
            for s in (1, 2, 5, 10)
        ]
        within = f"{row['within_10s']:.2f}" if "within_10s" in row else "-"
        cells = "".join(f"{pair:>14}" for pair in pairs)
        lines.append(
            f"{row['class']:<12}{row['episodes']:>6.0f}{cells}{within:>8}{row['calibration']:>13.2f}"
        )
    return "\n".join(lines)
