"""What a training ends with: how good the agent is, where it lies, and what can be done with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from reproduce.files import read_json
from tactile_kit.evaluation.intervals import wilson
from tactile_kit.progress import duration


def summary(directory: Path) -> str:
    """Some lines on the agent in ``directory``."""
    manifest = read_json(directory / "agent.json")
    objects = manifest["objects"]
    lines = [
        (
            "trained",
            f"{manifest['steps']:,} steps in {duration(3600 * manifest['hours'])}{_before(manifest)}",
        ),
        ("success", _success(manifest)),
        ("agent", f"{directory}  (README.md is its card, metrics.jsonl and tensorboard/ its curves)"),
        ("look", f"reproduce view --agent {directory} --objects {objects.split(',')[0]}"),
        ("film", f"reproduce film --agent {directory} --objects {objects} --out {directory.name}.gif"),
        (
            "evaluate",
            f"reproduce evaluate --agent {directory} --objects {objects} --out {directory.name}.csv",
        ),
    ]
    return "\n".join(f"{name:<10}{text}" for name, text in lines)


def _before(manifest: dict[str, Any]) -> str:
    start = manifest.get("warm_start")
    return f", from {start['from']} of {start['steps']:,} steps" if start else ""


def _success(manifest: dict[str, Any]) -> str:
    held_out, training = manifest.get("evaluation"), manifest.get("training") or {}
    if held_out:
        rate, count = held_out["success_rate"], held_out["episodes"]
        low, high = wilson(round(rate * count), count)
        return f"{rate:.2f} ({low:.2f} to {high:.2f}) of {count} held-out episodes, drops {held_out['drops']:.2f}"
    if training.get("success") is None:
        return "no episode has ended yet"
    return f"{training['success']:.2f} of the last episodes, exploring; not evaluated held out (evaluation.at_end)"
