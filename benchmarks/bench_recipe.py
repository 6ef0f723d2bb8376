"""Steps a second of the training recipe, learning included, and where the time goes.

    python benchmarks/bench_recipe.py [--turns 12] [--quick]

Preset ``ppo-compiled`` on the cube at nominal size, from the start of a training (light gravity, thick air). One core
and two, and torch's own threads instead of the learner's, take turns in one process: a roll-out and its update each;
then once more while another process keeps one core busy.
Beside it, in turns of whole processes on one core, the learner of the last revision before all this was looked at, read
from the history of this repository; its physics is another one, so all but the physics is compared.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from record import ROOT, Sections, arguments, write

from tactile_kit.runs.config import RunConfig
from tactile_kit.runs.metrics import Tracker
from tactile_kit.runs.training import default_env, make_learner

BEFORE = "1e2171d9f07c36ee5264f7afef1207dd57881d7a"
ENVIRONMENTS = (512, 1024)
PHYSICS = "physics"


@dataclass(frozen=True)
class Layout:
    """How a training is spread: threads of the physics, of the learner, and of torch inside one operation."""

    workers: int
    threads: int
    torch: int


LAYOUTS = {
    "one core": Layout(1, 1, 1),
    "two cores": Layout(2, 2, 1),
    "two cores, torch's threads": Layout(2, 1, 2),
}


class Training:
    """A training past its first update, of which roll-outs with their updates are timed."""

    def __init__(self, layout: Layout, config: RunConfig) -> None:
        self.layout, self.walls, self.cpus = layout, [], []
        torch.set_num_threads(layout.torch)
        torch.set_float32_matmul_precision(config.matmul_precision)
        self.env = env = default_env(config)
        env.set_gravity(config.gravity.at(0))
        self.learner = learner = make_learner(config, env)
        self.tracker = Tracker(env.num_envs)
        learner._setup_learn(10**9, self.tracker)
        learner.iterate(self.tracker)
        self.sections = Sections(time.process_time)
        # the learner of the history has another way to look at observations
        look = (learner, "_look") if hasattr(learner, "_look") else (learner.policy, "moments_and_values")
        self.places = {
            "update": (learner, "train"),
            "policy": look,
            "observation, reward, episodes": (env, "step_wait"),
            PHYSICS: (env.simulation, "step_wait"),
            "sending actions": (env.simulation, "step_async"),
        }
        self.seconds = dict.fromkeys(self.places, 0.0)

    def turn(self) -> None:
        """A roll-out and its update."""
        torch.set_num_threads(self.layout.torch)
        steps, wall, cpu = self.learner.num_timesteps, time.perf_counter(), time.process_time()
        with self.sections.patched(self.places):
            self.learner.iterate(self.tracker)
        steps = self.learner.num_timesteps - steps
        self.walls.append((time.perf_counter() - wall) / steps)
        self.cpus.append((time.process_time() - cpu) / steps)
        for name in self.seconds:
            self.seconds[name] += self.sections.seconds[name] / steps

    def result(self) -> dict[str, Any]:
        """Steps a second and CPU µs a step, all threads counted."""
        parts = {name: 1e6 * seconds / len(self.cpus) for name, seconds in self.seconds.items()}
        parts[PHYSICS] += parts.pop("sending actions")
        whole = 1e6 * float(np.mean(self.cpus))
        return {
            "steps_per_second": 1.0 / float(np.median(self.walls)),
            "steps_per_second_best": 1.0 / min(self.walls),
            "microseconds": whole,
            "parts": {**parts, "everything else": whole - sum(parts.values())},
        }


def oracle(layout: Layout, environments: int) -> Training:
    """The preset's training on the cube."""
    changes = {
        "objects": "cube",
        "scaling": "nominal",
        "num_envs": environments,
        "num_workers": layout.workers,
    }
    return Training(layout, RunConfig.preset("ppo-compiled", {**changes, "threads": layout.threads}))


def layouts(environments: int, turns: int) -> dict[str, Any]:
    """All layouts in turns."""
    trainings = {name: oracle(layout, environments) for name, layout in LAYOUTS.items()}
    for _ in range(turns):
        for training in trainings.values():
            training.turn()
    for training in trainings.values():
        training.env.close()
    return {name: training.result() for name, training in trainings.items()}


@contextmanager
def other_work() -> Iterator[None]:
    """Another process that keeps one core busy."""
    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def one_core(environments: int, turns: int) -> dict[str, Any]:
    """The training of whatever revision is imported, on one core."""
    training = oracle(LAYOUTS["one core"], environments)
    for _ in range(turns):
        training.turn()
    training.env.close()
    return training.result()


def against_history(environments: int, turns: int, processes: int) -> dict[str, Any] | None:
    """CPU µs a step of all but the physics, before and now, by processes in turns; None without the history."""
    try:
        archive = subprocess.run(["git", "archive", BEFORE], cwd=ROOT, check=True, capture_output=True).stdout
    except subprocess.CalledProcessError:
        return None
    found: dict[str, list[dict[str, Any]]] = {"before": [], "now": []}
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
            tar.extractall(folder, filter="data")
        for _ in range(processes):
            for name, tree in (("before", folder), ("now", str(ROOT))):
                command = [sys.executable, __file__, "--one-core", str(environments), str(turns)]
                run = subprocess.run(
                    command, env={**os.environ, "PYTHONPATH": tree}, cwd=tree, check=True, capture_output=True
                )
                found[name].append(json.loads(run.stdout.splitlines()[-1]))
    rest = {
        name: [run["microseconds"] - run["parts"][PHYSICS] for run in runs] for name, runs in found.items()
    }
    return {
        "revision": BEFORE,
        "environments": environments,
        **{name: runs[int(np.argsort(rest[name])[len(runs) // 2])] for name, runs in found.items()},
        "rest": {name: float(np.median(values)) for name, values in rest.items()},
        "ratio": float(np.median(np.array(rest["before"]) / np.array(rest["now"]))),
    }


def settings(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--turns", type=int, default=12, help="roll-outs of each layout", metavar="N")
    parser.add_argument("--one-core", type=int, nargs=2, help=argparse.SUPPRESS)


def main() -> None:
    options = arguments(__doc__ or "", settings)
    if options.one_core:
        print(json.dumps(one_core(*options.one_core)))
        return
    counts, turns = ((128,), 1) if options.quick else (ENVIRONMENTS, options.turns)
    alone = {str(count): layouts(count, turns) for count in counts}
    with other_work():
        beside = {str(counts[-1]): layouts(counts[-1], turns)}
    results = {
        "preset": "ppo-compiled",
        "layouts": alone,
        "beside_other_work": beside,
        "history": against_history(counts[-1], min(turns, 4), 1 if options.quick else 3),
    }
    write("recipe", results, options, ("torch", "stable-baselines3", "numpy", "numba"))


if __name__ == "__main__":
    main()
