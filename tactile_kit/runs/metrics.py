"""What a run reports while it trains: smoothed episode statistics, metrics.jsonl and TensorBoard."""

from __future__ import annotations

import io
import json
import math
import os
import platform
import shutil
import time
from collections import deque
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from tactile_kit.runs.disk import Appended, Disk

WINDOW = 500  # episodes that the smoothed figures run over, at least
_WAITS = "it waits in memory, the training goes on"


class Tracker(BaseCallback):
    """Collects finished episodes and reward terms from the environment's infos and transitions.

    ``stop`` set by anyone ends the roll-out in progress at the next step.

    Args:
        num_envs: environments. The figures run over twice as many episodes or more: those that began together also end
            together unless they drop, so a shorter window would hold now the drops and now the others.
    """

    def __init__(self, num_envs: int = 1) -> None:
        super().__init__()
        self.episodes = self.successes = 0
        self._length = max(WINDOW, 2 * num_envs)
        self.window: dict[str, deque[float]] = {
            name: deque(maxlen=self._length)
            for name in ("success", "theta", "drop", "fault", "return", "length")
        }
        self._terms: dict[str, float] = {}
        self._term_steps = 0

    def _on_step(self) -> bool:
        infos = self.locals["infos"]
        for environment in np.flatnonzero(self.locals["dones"]).tolist():
            self.episodes += 1
            self.successes += bool(infos[environment]["success"])
            self._add(infos[environment])
        transition = self.locals["env"].transition
        for name, values in transition.reward_terms.items():
            self._terms[name] = self._terms.get(name, 0.0) + float(np.mean(values))
        self._term_steps += 1
        return True

    def _add(self, info: dict[str, Any]) -> None:
        self.window["success"].append(float(info["success"]))
        self.window["drop"].append(float(info["drop"]))
        self.window["fault"].append(float(info.get("fault") is not None))
        self.window["return"].append(float(info["episode"]["r"]))
        self.window["length"].append(float(info["episode"]["l"]))
        theta = info.get("theta")
        if theta is not None and math.isfinite(theta):  # a fault has no final angle
            self.window["theta"].append(float(theta))

    def metrics(self) -> dict[str, Any]:
        """Means over the last episodes (None before the first) and of reward terms a step since the last call."""

        def mean(name: str) -> float | None:
            return float(np.mean(self.window[name])) if self.window[name] else None

        line: dict[str, Any] = {
            "success": mean("success"),
            "theta": mean("theta"),
            "drops": mean("drop"),
            "faults": mean("fault"),
            "reward": mean("return"),
            "length": mean("length"),
            "episodes": self.episodes,
        }
        line |= {f"reward_{name}": total / self._term_steps for name, total in self._terms.items()}
        self._terms, self._term_steps = {}, 0
        return line

    @property
    def drops(self) -> float | None:
        """Share of the last episodes that ended in a drop or a fault; None before the first."""
        window = self.window
        return float(np.mean(window["drop"]) + np.mean(window["fault"])) if window["drop"] else None

    def state(self) -> dict[str, Any]:
        """JSON values for a checkpoint."""
        windows = {name: list(values) for name, values in self.window.items()}
        return {
            "episodes": self.episodes,
            "successes": self.successes,
            "window": windows,
            "terms": self._terms,
            "term_steps": self._term_steps,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Inverse of :meth:`state`."""
        self.episodes, self.successes = state["episodes"], state["successes"]
        for name, values in state["window"].items():
            self.window[name] = deque(values, maxlen=self._length)
        self._terms, self._term_steps = dict(state["terms"]), state["term_steps"]


class MetricsFile:
    """metrics.jsonl, one JSON object a line, and the same numbers for TensorBoard. On a full disk lines wait for room.

    Args:
        directory: the run directory.
        step: environment steps of the checkpoint resumed from (0 for a fresh run): later lines are dropped.
        disk: what tells of a disk that refuses them.
    """

    def __init__(self, directory: Path, step: int, disk: Disk) -> None:
        self._disk = disk
        self._lines = Appended(directory / "metrics.jsonl")
        if self._lines.path.exists():
            os.truncate(self._lines.path, _kept(self._lines.path.read_bytes(), step))
        board = directory / "tensorboard"
        if not step:  # curves of a start that never reached a checkpoint
            shutil.rmtree(board, ignore_errors=True)
        self._board = Appended(
            board / f"events.out.tfevents.{time.time():.6f}.{platform.node()}.{os.getpid()}"
        )
        self._add_events([{"file_version": "brain.Event:2"}, *_resumed(step)])

    def write(self, line: dict[str, Any]) -> None:
        """Append a line; numbers that are not finite raise ValueError."""
        text = json.dumps(line, allow_nan=False) + "\n"
        self._disk.attempt("metrics.jsonl", _WAITS, lambda: self._lines.add(text.encode()))
        group = "evaluation" if line.get("evaluation") else "training"
        self._add_events(
            {"step": line["step"], "summary": {"value": [{"tag": f"{group}/{name}", "simple_value": value}]}}
            for name, value in line.items()
            if isinstance(value, (int, float)) and not isinstance(value, bool) and name != "step"
        )

    def _add_events(self, events: Iterable[dict[str, Any]]) -> None:
        """Add to TensorBoard's file; its own writer ends for good with the first write that fails."""
        from tensorboard.compat.proto.event_pb2 import Event
        from tensorboard.summary.writer.record_writer import RecordWriter

        buffer = io.BytesIO()
        writer = RecordWriter(buffer)
        for event in events:
            writer.write(Event(wall_time=time.time(), **event).SerializeToString())
        self._disk.attempt("tensorboard", _WAITS, lambda: self._board.add(buffer.getvalue()))

    def close(self) -> None:
        """Write what still waits, if there is room for it by now."""
        self._disk.attempt("metrics.jsonl", _WAITS, self._lines.flush)
        self._disk.attempt("tensorboard", _WAITS, self._board.flush)


def _resumed(step: int) -> list[dict[str, Any]]:
    """The event that makes TensorBoard drop what an earlier start wrote after ``step``."""
    return [{"step": step + 1, "session_log": {"status": "START"}}] if step else []


def _kept(data: bytes, step: int) -> int:
    """Bytes of ``data`` up to the last whole line that is not after ``step``; 0 for a fresh run."""
    end = at = 0
    for line in data.splitlines(keepends=True) if step else ():
        at += len(line)
        if line.endswith(b"\n") and _step_of(line) <= step:
            end = at
    return end


def read_metrics(directory: str | Path) -> list[dict[str, Any]]:
    """The lines of a run's metrics.jsonl; a line cut short by a kill is left out."""
    path = Path(directory) / "metrics.jsonl"
    lines = []
    for line in path.read_bytes().splitlines():
        if math.isfinite(_step_of(line)):
            lines.append(json.loads(line))
    return lines


def _step_of(line: bytes) -> float:
    try:
        return float(json.loads(line)["step"])
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return math.inf  # cut short
