"""What trainings at the paper's sizes cost, and what Ray actors add to worker processes.

    python benchmarks/bench_cluster.py [--turns 3] [--quick] [--only learners|ray]

Learners: CPU time of the parent for a step of the preset ``ppo-paper``, of an oracle and of a tactile agent, with fewer
environments than its 4,096, since all of it is proportional to samples. Ray: two actors and two worker processes of 32
environments take turns, a step each; the CPU time of everything that works for it, by /proc, and wall time.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from bench_recipe import Layout, Training
from record import RESULTS, arguments, write

import tactile_kit
from tactile_kit.runs.config import RunConfig
from tactile_kit.simulation.ray_workers import BEGUN, SENT, STEPPED
from tactile_kit.simulation.worker import FIELDS

ENVIRONMENTS = 64
PATIENCE = 3.0  # s that Ray's own processes have to calm down in


def learner(kind: str, turns: int) -> dict[str, Any]:
    """CPU µs of the parent for a step, and its memory (MB)."""
    rollout = RunConfig.preset("ppo-paper").ppo.rollout
    config = RunConfig.preset(
        "ppo-paper",
        {
            "kind": kind, "objects": "cube", "scaling": "nominal", "num_envs": ENVIRONMENTS, "num_workers": 1,
            "threads": 1, "ppo": {"minibatch": ENVIRONMENTS * rollout}, "episodes": {"grasps": 8},
        },
    )  # fmt: skip
    training = Training(Layout(1, 1, 1), config)
    if kind == "tactile":
        coupling = training.env.coupling
        training.places |= {
            "estimates": (coupling, "update"),
            "estimator's updates": (coupling.trainer, "train"),
        }
        training.seconds = dict.fromkeys(training.places, 0.0)
    for _ in range(turns):
        training.turn()
    found = training.result()
    # waiting for the workers is no work
    parts = {name: value for name, value in found["parts"].items() if name != "physics"}
    learners = training.learner.policy.parameters()
    result = {
        "parts": parts,
        "weights": sum(one.numel() for one in learners),
        "epochs": config.ppo.epochs,
        "resident_mb": _resident(),
    }
    if kind == "tactile":
        result["estimator_weights"] = sum(one.numel() for one in training.env.estimator.parameters())
        result["reuse"] = config.ecrl.reuse
    training.env.close()
    return result


def _resident() -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1024


def ticks() -> dict[int, float]:
    """CPU seconds of this process and of all that it has started, Ray's own processes too."""
    parents, used = {}, {}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            fields = (process / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parents[int(process.name)] = int(fields[1])
        used[int(process.name)] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    ours = {os.getpid()}
    while more := {one for one, parent in parents.items() if parent in ours} - ours:
        ours |= more
    return {one: used[one] for one in ours if one in used}


def ray_overhead(turns: int) -> dict[str, Any]:
    """Steps by actors beside steps by processes."""
    import ray

    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, object_store_memory=80_000_000)
    count = 64
    settings: dict[str, Any] = {"objects": "cube", "grasps": 8, "num_envs": count, "num_workers": 2}
    envs = {kind: tactile_kit.make_vec(workers=kind, **settings) for kind in ("processes", "ray")}
    rng = np.random.default_rng(0)
    for env in envs.values():
        env.reset()
    time.sleep(PATIENCE)
    walls: dict[str, list[float]] = {kind: [] for kind in envs}
    cpus: dict[str, list[float]] = {kind: [] for kind in envs}
    for _ in range(turns):
        actions = [rng.uniform(-1, 1, (count, 12)).astype(np.float32) for _ in range(20)]
        for kind, env in envs.items():
            before, began = ticks(), time.perf_counter()
            for action in actions:
                env.step(action)
            walls[kind].append((time.perf_counter() - began) / len(actions))
            after = ticks()
            cpus[kind].append(
                sum(value - before.get(one, value) for one, value in after.items()) / len(actions)
            )
    for env in envs.values():
        env.close()
    ray.shutdown()
    sizes = {
        name: int(np.prod(shape, dtype=int)) * np.dtype(dtype).itemsize
        for name, (shape, dtype) in FIELDS.items()
    }
    return {
        "environments": count,
        "workers": 2,
        "turns": turns,
        "milliseconds": {kind: 1e3 * median(values) for kind, values in walls.items()},
        "cpu_milliseconds": {kind: 1e3 * float(np.mean(values)) for kind, values in cpus.items()},
        "wall_ratio": median(a / b for a, b in zip(walls["ray"], walls["processes"], strict=True)),
        "cpu_ratio": float(np.sum(cpus["ray"]) / np.sum(cpus["processes"])),
        "bytes": {
            "sent": sum(sizes[name] for name in SENT),
            "received": sum(sizes[name] for name in STEPPED),
            "begun": sum(sizes[name] for name in BEGUN),
        },
    }


def settings(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--turns", type=int, default=3, help="roll-outs of each learner", metavar="N")
    parser.add_argument(
        "--only", choices=("learners", "ray"), help="measure this, keep the rest of the record"
    )


def main() -> None:
    options = arguments(__doc__ or "", settings)
    record = RESULTS / "cluster.json"
    found = json.loads(record.read_text()) if options.only and record.is_file() else {}
    results = {name: found[name] for name in ("learners", "ray") if name in found}
    turns = 1 if options.quick else options.turns
    if options.only != "ray":
        results["learners"] = {kind: learner(kind, turns) for kind in ("oracle", "tactile")}
    if options.only != "learners":
        results["ray"] = ray_overhead(10 * turns)
    write("cluster", results, options, ("torch", "ray", "numpy", "pybullet"))


if __name__ == "__main__":
    main()
