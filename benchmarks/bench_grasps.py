"""Grasps before the first step: what a training waits for from an empty cache, and what the grasps are worth.

    python benchmarks/bench_grasps.py [--quick]

The bank of the shipped oracles' training (eight shapes, nominal and in 16 random sizes each, 32 grasps), found by two
processes in Bullet and in the compiled physics: seconds, and CPU seconds of all processes, their start included.

- held: every grasp's own command for a second in Bullet at the step of evaluations, without randomisation; held is
  within 5 mm and 0.15 rad of where it was.
- agent: a shipped oracle's episodes in Bullet at that step, from either bank, with the same sizes, goals and seeds.
"""

from __future__ import annotations

import os
import tempfile
import time
from itertools import product
from typing import Any

import numpy as np
from record import ROOT, arguments, write

import randomization
from tactile_kit.agents import load_agent
from tactile_kit.evaluation.intervals import wilson
from tactile_kit.evaluation.schedule import HORIZON, STEPS_PER_SECOND, evaluation_task
from tactile_kit.rotations import geodesic, octahedral
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.config import CONTROL_RATE, SimulationConfig
from tactile_kit.simulation.episode import dropped
from tactile_kit.simulation.world import World
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.goals import EpisodeSpec
from tactile_kit.task.variants import Variants, prepare

AGENT = ROOT / "results" / "agents" / "oracle-vec_bps-geometric8-s0"
WORKERS = 2
NEAR, TURNED = 5e-3, 0.15  # m, rad


def search(task: TaskConfig, workers: int) -> tuple[Variants, dict[str, float]]:
    """The task's bank from an empty cache."""
    with tempfile.TemporaryDirectory() as folder:
        kept = os.environ.get("TACTILE_KIT_CACHE")
        os.environ["TACTILE_KIT_CACHE"] = folder
        try:
            began, before = time.monotonic(), sum(os.times()[:4])
            variants = prepare(task, workers)
            taken = {"seconds": time.monotonic() - began, "cpu_seconds": sum(os.times()[:4]) - before}
        finally:
            os.environ.pop("TACTILE_KIT_CACHE")
            if kept is not None:
                os.environ["TACTILE_KIT_CACHE"] = kept
    return variants, taken


def rate(successes: Any) -> dict[str, Any]:
    low, high = wilson(int(np.sum(successes)), len(successes))
    return {"rate": float(np.mean(successes)), "low": low, "high": high, "n": len(successes)}


def hold(variants: Variants, grasps: int) -> dict[str, Any]:
    """The first ``grasps`` of every object and size, held for a second."""
    world = World(SimulationConfig(steps_per_second=STEPS_PER_SECOND))
    physics = randomization.preset("none").draw("episode", 0)
    held, fell = [], []
    for index, thing in enumerate(variants.objects):
        body = Body(thing)
        for number in range(grasps):
            grasp = variants.bank.grasp(index, number)
            world.load(body, physics)
            world.place(grasp)
            for _ in range(CONTROL_RATE):
                world.step(grasp.command)
            away = np.linalg.norm(world.position - grasp.position)
            held.append(away < NEAR and geodesic(world.rotation, grasp.rotation) < TURNED)
            fell.append(bool(dropped(world.position)))
    world.close()
    return {"held": rate(held), "fell": rate(fell)}


def play(variants: Variants, repeats: int, workers: int) -> dict[str, Any]:
    """The agent's episodes on every size that a training plays."""
    agent = load_agent(AGENT)
    task = evaluation_task(agent.task, "geometric8", 0, "random")
    specs = []
    for variant, repeat in product(np.flatnonzero(variants.playable).tolist(), range(repeats)):
        seed = randomization.derive(0, "benchmark", "grasps", variant, repeat)
        specs.append(EpisodeSpec(variant, variant, octahedral()[1 + seed % 23], seed))
    env = agent.make_env(
        task, num_envs=min(16, len(specs)), num_workers=workers, episodes=specs, variants=variants
    )
    observations = env.reset()
    for _ in range((HORIZON + 1) * len(specs)):
        env.step_async(agent.act(observations))
        observations = env.step_wait()[0]
        if all(result is not None for result in env.results):
            break
    env.close()
    early = [result.drop and result.steps <= CONTROL_RATE for result in env.results]
    return {
        "dropped_in_a_second": rate(early),
        "dropped": rate([result.drop for result in env.results]),
        "success": rate([result.success for result in env.results]),
    }


def main() -> None:
    options = arguments(__doc__ or "")
    settings: dict[str, Any] = (
        {"variants": 1, "grasps": 4} if options.quick else {"variants": 16, "grasps": 32}
    )
    results: dict[str, Any] = {"workers": WORKERS, "banks": {}}
    for engine in ("compiled", "bullet"):
        simulation = {"engine": engine}
        task = TaskConfig(scaling="random", grasp_spread=0.1, simulation=simulation, **settings)
        variants, taken = search(task, WORKERS)
        results["banks"][engine] = {
            "objects": len(variants),
            "grasps": len(variants.bank.joints),
            **taken,
            **hold(variants, 1 if options.quick else 4),
            **play(variants, 1 if options.quick else 3, WORKERS),
        }
        print(engine, results["banks"][engine], flush=True)
    write("grasps", results, options, ("pybullet", "numba", "numpy"))


if __name__ == "__main__":
    main()
