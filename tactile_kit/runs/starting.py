"""What a training says when it starts: what is prepared, where it begins, and what a kill has cost."""

from __future__ import annotations

from pathlib import Path

from tactile_kit.progress import duration
from tactile_kit.runs.checkpoint import Checkpoint
from tactile_kit.runs.config import RunConfig
from tactile_kit.runs.metrics import read_metrics


def whole_rollouts(config: RunConfig) -> int:
    """Environment steps at the end: training stops after the roll-out that reaches ``config.steps``."""
    batch = config.num_envs * config.ppo.rollout
    return -(-config.steps // batch) * batch


def starting(config: RunConfig, directory: Path, saved: Checkpoint | None, killed: str) -> list[str]:
    """Lines for whoever looks on.

    Args:
        saved: the checkpoint that is taken up, None for a fresh start.
        killed: who was killed at work in the directory, empty where nobody was.
    """
    lines = [text] if (text := lost(directory, saved, killed)) else []
    if saved is not None:
        lines.append(f"goes on at {saved.step:,} of {config.steps:,} steps")
    lines.append(
        f"prepares {config.num_envs} environments of {config.objects}, {config.num_workers} processes; grasps that "
        "were never looked for take a minute or two"
    )
    return lines


def lost(directory: Path, saved: Checkpoint | None, killed: str) -> str:
    """What a run that did not end by itself has lost, in words; empty where nothing is known to be."""
    path = directory / "metrics.jsonl"
    last = (
        max(read_metrics(directory), key=lambda line: line["step"], default=None) if path.exists() else None
    )
    step, hours = (saved.step, float(saved.values["hours"])) if saved is not None else (0, 0.0)
    beyond = last is not None and last["step"] > step
    if not killed and not beyond:
        return ""
    who = f"{killed} was killed here" if killed else "the last start ended before it could save"
    if last is None or not beyond:
        return (
            f"{who}: what it did since the checkpoint at {step:,} steps is lost"
            if step
            else f"{who}, nothing saved"
        )
    spent = duration(3600 * (float(last.get("hours", hours)) - hours))
    return f"{who}: at least {last['step'] - step:,} steps ({spent}) after {step:,} are lost and done again"
