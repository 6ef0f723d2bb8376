"""A tenth of a second of hand and object, ours beside Gymnasium-Robotics' shadow hand with touch sensors (MuJoCo).

    python benchmarks/bench_peer.py [--python PATH] [--quick]

The peer, ``HandManipulateBlock_ContinuousTouchSensors``, needs a MuJoCo older than this project's own, so it runs in
an interpreter of its own: ``--python``, by default ``.venv-peer/bin/python`` where that is there. Both step in turns,
in CPU time; the peer's actions are small random ones, ours hold a cube under small noise. Resets are in both.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
from record import ROOT, arguments, write
from timing import Holding, cpu_seconds

from tactile_kit.task.config import TaskConfig

PEER = "HandManipulateBlock_ContinuousTouchSensors-v1"
INSTALL = "python -m venv .venv-peer && .venv-peer/bin/pip install gymnasium-robotics 'mujoco<3.4'"
# Reads a number of steps, answers with the CPU seconds they took; first line: seconds simulated a step and versions.
SERVER = f"""
import importlib.metadata, json, sys, time
import gymnasium, gymnasium_robotics
gymnasium.register_envs(gymnasium_robotics)
env = gymnasium.make("{PEER}")
env.reset(seed=0)
env.action_space.seed(0)
versions = {{name: importlib.metadata.version(name) for name in ("gymnasium-robotics", "mujoco")}}
print(json.dumps({{"step": env.unwrapped.dt, "versions": versions}}), flush=True)
for line in sys.stdin:
    start = time.process_time()
    for _ in range(int(line)):
        _, _, terminated, truncated, _ = env.step(0.3 * env.action_space.sample())
        if terminated or truncated:
            env.reset()
    print(time.process_time() - start, flush=True)
"""


class Peer:
    """The other environment in its own process."""

    def __init__(self, python: Path) -> None:
        self.process = subprocess.Popen(
            [str(python), "-W", "ignore", "-c", SERVER],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            assert self.process.stderr is not None
            self.error = self.process.stderr.read().strip().splitlines()[-1]
            raise ModuleNotFoundError(self.error)
        about = json.loads(line)
        self.step, self.versions = float(about["step"]), about["versions"]

    def milliseconds(self, seconds: float) -> float:
        """CPU time of 0.1 s simulated, over about so many simulated seconds."""
        assert self.process.stdin is not None and self.process.stdout is not None
        steps = round(seconds / self.step)
        self.process.stdin.write(f"{steps}\n")
        self.process.stdin.flush()
        return float(self.process.stdout.readline()) / (steps * self.step) * 100

    def close(self) -> None:
        self.process.communicate()


def main() -> None:
    def add(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("--python", type=Path, help="interpreter that has gymnasium-robotics")

    options = arguments(__doc__ or "", add)
    torch.set_num_threads(1)
    own = ROOT / ".venv-peer" / "bin" / "python"
    python = options.python or (own if own.exists() else Path(sys.executable))
    results: dict[str, Any] = {"peer": PEER, "install": INSTALL}
    try:
        peer = Peer(python)
    except (ModuleNotFoundError, FileNotFoundError) as error:
        print(f"no peer: {error} (to install it: {INSTALL})")
        results["missing"] = str(error)
        peer = None
    rates = (60,) if options.quick else (60, 120, 240)
    tasks = {rate: TaskConfig(objects="cube", simulation={"steps_per_second": rate}) for rate in rates}
    holdings = {rate: Holding(task, 16) for rate, task in tasks.items()}
    times: dict[str, list[float]] = {str(rate): [] for rate in rates}
    if peer is not None:
        peer.milliseconds(2)
        times["peer"] = []
    for _ in range(2 if options.quick else 6):
        for rate, holding in holdings.items():
            times[str(rate)].append(cpu_seconds(holding.run, 25) / (25 * 16) * 1e3)
        if peer is not None:
            times["peer"].append(peer.milliseconds(8))
    for holding in holdings.values():
        holding.env.close()
    results["milliseconds"] = {name: float(np.median(values)) for name, values in times.items()}
    if peer is not None:
        peer.close()
        results["versions"] = peer.versions
        results["peer_over_ours"] = {
            name: float(np.median(np.array(times["peer"]) / np.array(values)))
            for name, values in times.items()
            if name != "peer"
        }
    write("peer", results, options, ("pybullet", "numpy", "torch"))


if __name__ == "__main__":
    main()
