"""Trains the runs of one job, one after another. What is finished is left alone; what was stopped goes on."""

from __future__ import annotations

import hashlib
import json
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from reproduce.errors import ReproduceError, Stopped
from reproduce.files import read_yaml, write_atomic
from reproduce.heartbeat import Heartbeat
from tactile_kit.errors import LockedError

PATIENCE = 300.0  # s for another process to leave the directory: an earlier start of this job, on a node that was lost


def run(pipeline: Path, item: str, beat: Heartbeat) -> None:
    entries = read_yaml(pipeline / "jobs" / "train" / f"{item}.yaml")
    total = sum(entry["config"]["steps"] for entry in entries)
    done = 0
    marker = {}
    for entry in entries:
        directory = Path(entry["directory"])

        def report(steps: int, before: int = done) -> None:
            beat(min(total, before + steps), total)

        _train(entry["config"], directory, report)
        done += entry["config"]["steps"]
        beat(done, total)
        marker[entry["run"]] = hashlib.sha256((directory / "agent.json").read_bytes()).hexdigest()
    write_atomic(pipeline / "trained" / f"{item}.json", json.dumps(marker, indent=1) + "\n")


def _train(settings: dict[str, Any], directory: Path, report: Callable[[int], None]) -> None:
    """One run of the workflow. A directory that holds a run of other settings is moved aside, never overwritten."""
    from tactile_kit.runs import RunConfig
    from tactile_kit.runs.config import differences

    config = RunConfig.build(settings, source=directory.name)
    there = directory / "config.yaml"
    if there.is_file() and (changed := differences(read_yaml(there), config.to_dict())):
        aside = _move_aside(directory)
        print(
            f"{directory.name}: settings changed ({'; '.join(changed)}); the old run is now {aside}",
            flush=True,
        )
    with _following(directory / "metrics.jsonl", report):
        _when_free(lambda: train_config(config, directory))


def _when_free(work: Callable[[], None]) -> None:
    deadline, said = time.monotonic() + PATIENCE, False
    while True:
        try:
            return work()
        except LockedError as error:
            if time.monotonic() > deadline:
                raise
            if not said:
                print(f"{error}; waits for it", flush=True)
            said = True
            time.sleep(1.0)


def train_config(config: Any, directory: Path) -> None:
    """Trains ``config`` (a ``RunConfig``) in ``directory``; raises ``Stopped`` where a signal ended it early."""
    from tactile_kit.runs import finished, train

    if finished(directory) and read_yaml(directory / "config.yaml") == config.to_dict():
        return
    train(config, directory)
    if not finished(directory):
        raise Stopped(
            f"{directory}: stopped before the end; the same command goes on from the last checkpoint"
        )


def _move_aside(directory: Path) -> Path:
    for number in range(1, 10_000):
        aside = directory.parent / ".replaced" / f"{directory.name}-{number}"
        if not aside.exists():
            aside.parent.mkdir(exist_ok=True)
            os.replace(directory, aside)
            return aside
    raise ReproduceError(f"{directory.parent / '.replaced'}: 10,000 old runs; remove some")


@contextmanager
def _following(metrics: Path, report: Callable[[int], None]) -> Iterator[None]:
    """Reports the run's steps while it trains, from the last line of its metrics."""
    ended = threading.Event()

    def follow() -> None:
        while not ended.wait(1.0):
            try:
                last = metrics.read_bytes().splitlines()[-1]
                report(int(json.loads(last)["step"]))
            except (OSError, ValueError, KeyError, IndexError):
                continue  # not written yet, or just being written

    thread = threading.Thread(target=follow, daemon=True, name="metrics")
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
