"""Evaluates one agent into one episode file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from reproduce.files import read_yaml, require_agent, write_atomic
from reproduce.heartbeat import Heartbeat

if TYPE_CHECKING:
    from tactile_kit.evaluation.rows import EpisodeRow


def run(pipeline: Path, item: str, beat: Heartbeat) -> None:
    settings = read_yaml(pipeline / "jobs" / "evaluate" / f"{item}.yaml")
    out = Path(settings.pop("out"))
    summary = evaluate_to(Path(settings.pop("agent")), out, progress=beat, **settings)
    summary["digest"] = hashlib.sha256(out.read_bytes()).hexdigest()
    write_atomic(pipeline / "evaluated" / f"{item}.json", json.dumps(summary, indent=1) + "\n")


def evaluate_to(agent: Path, out: Path, **settings: Any) -> dict[str, Any]:
    """Evaluates the agent in directory ``agent`` and writes its rows to ``out``; settings as ``tactile_kit.evaluate``.

    Returns ``summary_of`` the rows.

    Raises:
        ReproduceError: there is no agent.
        ObjectSetError: ``out`` or the cache can't be written, found before any work.
    """
    require_agent(agent)
    from object_sets.storage import cache_directory, check_file_writable, check_writable

    check_file_writable(out, "--out")
    check_writable(cache_directory(), "cache")
    import torch

    from tactile_kit.evaluation import evaluate, write_rows

    torch.set_num_threads(1)
    rows = evaluate(agent, **settings)
    write_rows(out, rows)
    return summary_of(rows, out)


def summary_of(rows: Sequence[EpisodeRow], out: Path) -> dict[str, Any]:
    """success_rate with its 95 % interval, episodes, drops, faults, mean_final_angle (rad), out."""
    from tactile_kit.evaluation import final_angles, success_rate

    rate = success_rate(rows)
    angles = final_angles(rows)
    return {
        "success_rate": rate.value,
        "low": rate.low,
        "high": rate.high,
        "episodes": rate.n,
        "drops": sum(row.drop for row in rows),
        "faults": sum(bool(row.fault) for row in rows),
        "mean_final_angle": float(angles.mean()) if len(angles) else None,
        "out": str(out),
    }
