"""Loads every object and notes its content, so that a changed mesh re-runs what depends on it."""

from __future__ import annotations

import json
from pathlib import Path

from reproduce.files import read_yaml, write_atomic
from reproduce.heartbeat import Heartbeat


def run(pipeline: Path, item: str, beat: Heartbeat) -> None:
    import object_sets

    wanted = read_yaml(pipeline / "jobs" / "objects.yaml")["objects"]
    digests = {f"{thing.id} {thing.name}": thing.digest for thing in object_sets.load(wanted)}
    write_atomic(pipeline / "objects.json", json.dumps(digests, indent=1) + "\n")
