"""Trains on a disk that is full from step 600 to step 1,500: ``unshare -rm python full_disk_run.py FOLDER``.

FOLDER becomes a small file system of its own, which only this process sees; what stays is printed as JSON.
"""

from __future__ import annotations

import ctypes
import json
import os
import sys
from pathlib import Path

from toy_run import settings
from toy_task import ToyEnv

from tactile_kit.files import digest
from tactile_kit.runs import RunConfig, train

STEPS, FULL, EVERY = 2048, range(600, 1500), 128


class FillingEnv(ToyEnv):
    """Fills the disk to the last byte and later makes room again."""

    ballast: Path
    stepped = 0

    def step_wait(self):
        self.stepped += self.num_envs
        if self.stepped in FULL:
            fill(self.ballast)
        else:
            self.ballast.unlink(missing_ok=True)
        return super().step_wait()


def fill(ballast: Path) -> None:
    """Write to ``ballast`` until nothing more goes in."""
    with ballast.open("ab", buffering=0) as file:
        size = 4096
        while size:
            try:
                file.write(b"x" * size)
            except OSError:
                size //= 2


def filling(config: RunConfig) -> FillingEnv:
    return FillingEnv(config.num_envs, seed=config.seed, drop=0.02)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    done = ctypes.CDLL(None, use_errno=True).mount(b"tmpfs", os.fsencode(folder), b"tmpfs", 0, b"size=4m")
    if done != 0:
        raise OSError(ctypes.get_errno(), "mount")
    FillingEnv.ballast = folder / "ballast"
    run = train(settings(STEPS, log_every=EVERY), folder / "run", make_env=filling)
    left = {str(path.relative_to(run)): path for path in run.rglob("*") if path.is_file()}
    events = [path for name, path in left.items() if "tfevents" in name]
    from tensorboard.backend.event_processing.event_file_loader import EventFileLoader

    points = [[event.step, event.summary.value[0].tag] for path in events
              for event in EventFileLoader(str(path)).Load() if event.summary.value]  # fmt: skip
    found = {
        "metrics": left["metrics.jsonl"].read_text(),
        "checkpoints": sorted(path.name for path in (run / "checkpoints").iterdir()),
        "policy": digest(left["policy.safetensors"].read_bytes()),
        "points": points,
    }
    print(json.dumps(found))
