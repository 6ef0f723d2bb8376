"""The estimator by itself: trained on the streams of an agent that does not learn, and measured against time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from reproduce.cells import paper_values
from reproduce.files import require_agent
from tactile_kit.evaluation.estimates import SECONDS
from tactile_kit.runs.config import RunConfig

HEADS = {  # what a column is called, and the figure it shows
    "< 0.4": "within_10s",
    "> 1": "lost_10s",
    "error/sigma": "calibration",
    "success": "success",
    "drops": "drops",
    "believed": "believed",
    "reached": "reached",
}


def settings_of(agent: Path, steps: int, cell: str, loss: str, closed_loop: bool, seed: int) -> RunConfig:
    """A run in which ``agent`` acts, told the truth or (``closed_loop``) the estimate, and its estimator learns.

    Raises ``ReproduceError`` where there is no agent.
    """
    require_agent(agent)
    from tactile_kit.agents.manifest import read_manifest

    task = read_manifest(agent).task
    changes = {
        "kind": "tactile",
        "warm_start": str(agent),
        "steps": steps,
        "seed": seed,
        "task": {name: task[name] for name in ("objects", "encoding", "action", "scaling", "variants")},
        "ppo": {"fixed_steps": steps},
        "estimator": {"cell": cell, "loss": loss},
        "ecrl": {"rho_start": 0.0 if closed_loop else 1.0, "rho_step": 0.0},
    }
    return RunConfig.preset("tactile-compiled", changes)


def measure(
    agent: Path,
    objects: str,
    truth: bool,
    episodes: int,
    seed: int,
    estimator: str = "own",
    each: bool = False,
) -> list[dict[str, Any]]:
    """One row a class of Table I (``each``: an object), and one over all.

    ``class``, its or the object's name, and the figures of ``evaluation.estimates.Followed``.
    """
    from tactile_kit.agents.agent import load_agent
    from tactile_kit.evaluation.estimates import follow
    from tactile_kit.evaluation.estimators import told

    followed = follow(told(load_agent(agent), estimator), objects, truth=truth, episodes=episodes, seed=seed)
    everything = sorted(set(followed.object_id.tolist()))
    if each:
        import object_sets

        classes = [(thing.name, [thing.id]) for thing in object_sets.select(objects)]
    else:
        classes = [(row["name"], row["ids"]) for row in paper_values("table1")["rows"]]
    rows = [("All", everything), *((name, [i for i in ids if i in everything]) for name, ids in classes)]
    return [{"class": name, **followed.of(ids).figures()} for name, ids in rows if ids]


def table(rows: list[dict[str, Any]]) -> str:
    """The rows as people read them: mean and median error in rad."""
    columns = (*(f"{s} s" for s in SECONDS), *HEADS)
    width = max(len(row["class"]) for row in rows) + 2
    lines = [f"{'':<{width}}{'n':>6}" + "".join(f"{name:>12}" for name in columns)]
    for row in rows:
        pairs = [(f"mean_{s}s", f"median_{s}s") for s in SECONDS]
        cells = [f"{row[a]:.2f}/{row[b]:.2f}" if a in row else "-" for a, b in pairs]
        cells += [f"{row[name]:.3f}" if name in row else "-" for name in HEADS.values()]
        lines.append(
            f"{row['class']:<{width}}{row['episodes']:>6.0f}" + "".join(f"{cell:>12}" for cell in cells)
        )
    return "\n".join(lines)
