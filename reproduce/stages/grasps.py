"""Finds the initial grasps a task needs, before the jobs that would otherwise each look for the same ones."""

from __future__ import annotations

import json
from pathlib import Path

from reproduce.files import read_json, read_yaml, write_atomic
from reproduce.heartbeat import Heartbeat


def run(pipeline: Path, item: str, beat: Heartbeat) -> None:
    from tactile_kit.task.config import TaskConfig
    from tactile_kit.task.variants import prepare

    task = TaskConfig(**read_yaml(pipeline / "jobs" / "grasps" / f"{item}.yaml"))
    variants = prepare(task, read_json(pipeline / "plan.json")["num_workers"], progress=beat)
    found = {thing.name: 0 for thing in variants.objects}
    for index, thing in enumerate(variants.objects):
        found[thing.name] += variants.bank.count(index)
    write_atomic(pipeline / "grasps" / f"{item}.json", json.dumps(found, indent=1) + "\n")
