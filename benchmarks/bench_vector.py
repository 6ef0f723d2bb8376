"""Workers, memory and resets of the vector environment.

    python benchmarks/bench_vector.py [--quick]

Two workers beside one, in wall time and in turns with the machine's own ceiling: a loop without memory traffic or
communication in two processes beside one. Two virtual cores are often less than twice one. Memory: resident size of a
fresh process with few and with many environments, and of one environment over 1,000 resets that change the object and
its size. Resets: their CPU time as a share of episodes of 100 steps.
"""

from __future__ import annotations

import multiprocessing
import time
from typing import Any

import numpy as np
import torch
from record import arguments, write
from timing import Holding, cpu_seconds

from tactile_kit.hand.kinematics import FIRM_GRASP
from tactile_kit.simulation.episode import FULL_RANGE, MIDDLE
from tactile_kit.simulation.simulator import Simulator
from tactile_kit.simulation.world import LOADS_A_SCENE
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.core import Core
from tactile_kit.task.vec_env import ReorientVecEnv

SPIN = 4_000_000
ENVIRONMENTS = 32


def resident(process: int | str = "self") -> float:
    """Resident memory of a process, MB."""
    with open(f"/proc/{process}/status") as file:
        line = next(line for line in file if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


def _spin(pipe: Any) -> None:
    pipe.send(None)
    while pipe.recv():
        value = 0
        for number in range(SPIN):
            value ^= number
        pipe.send(value)


class Spinners:
    """Processes that count, without any memory traffic."""

    def __init__(self, number: int) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipes, self.processes = [], []
        for _ in range(number):
            ours, theirs = context.Pipe()
            self.processes.append(context.Process(target=_spin, args=(theirs,), daemon=True))
            self.processes[-1].start()
            self.pipes.append(ours)
        for pipe in self.pipes:
            pipe.recv()

    def rate(self, number: int) -> float:
        """Loops a second of ``number`` processes together."""
        start = time.perf_counter()
        for pipe in self.pipes[:number]:
            pipe.send(True)
        for pipe in self.pipes[:number]:
            pipe.recv()
        return number / (time.perf_counter() - start)

    def close(self) -> None:
        for pipe, process in zip(self.pipes, self.processes):
            pipe.send(False)
            process.join()


def _rate(env: ReorientVecEnv, actions: np.ndarray, steps: int) -> float:
    start = time.perf_counter()
    for _ in range(steps):
        env.step(actions)
    return steps * env.num_envs / (time.perf_counter() - start)


def workers(rounds: int) -> dict[str, Any]:
    """Control steps a second with one and with two workers, and the same ratio for counting loops."""
    task = TaskConfig(objects="cube")
    envs = {number: ReorientVecEnv(task, num_envs=ENVIRONMENTS, num_workers=number) for number in (1, 2)}
    actions = np.tile((FIRM_GRASP - MIDDLE) / FULL_RANGE, (ENVIRONMENTS, 1)).astype(np.float32)
    spinners = Spinners(2)
    rates: dict[str, list[float]] = {"1": [], "2": [], "loop 1": [], "loop 2": []}
    try:
        for env in envs.values():
            env.reset()
            _rate(env, actions, 10)
        for _ in range(rounds):
            for number, env in envs.items():
                rates[str(number)].append(_rate(env, actions, 25))
                rates[f"loop {number}"].append(spinners.rate(number))
    finally:
        spinners.close()
        for env in envs.values():
            env.close()
    one, two, loop_one, loop_two = (np.array(rates[name]) for name in ("1", "2", "loop 1", "loop 2"))
    return {
        "environments": ENVIRONMENTS,
        "steps_per_second": {"1": float(np.median(one)), "2": float(np.median(two))},
        "two_over_one": float(np.median(two / one)),
        "ceiling": float(np.median(loop_two / loop_one)),
        "share_of_ceiling": float(np.median(two / one) / np.median(loop_two / loop_one)),
    }


def memory_of_environments(many: int) -> dict[str, float]:
    """MB of a worker with one environment, and of each further one, after a few steps."""
    sizes = {}
    for number in (1, many):
        env = ReorientVecEnv(TaskConfig(objects="cube"), num_envs=number, num_workers=1)
        try:
            env.reset()
            _rate(env, np.zeros((number, 12), np.float32), 5)
            (worker,) = multiprocessing.active_children()
            sizes[number] = resident(worker.pid or "self")
        finally:
            env.close()
    return {"first_mb": sizes[1], "each_further_mb": (sizes[many] - sizes[1]) / (many - 1)}


def _resets(count: int, every: int, pipe: Any) -> None:
    core = Core(TaskConfig(objects="all", scaling="random", variants=4))
    simulator = core.blueprint.build()
    variants = len(core.variants)
    action = np.zeros(12)
    sizes = []
    # first every body once, whose shape stays, and one fresh scene, before which memory grows a little
    before = max(variants, LOADS_A_SCENE + 100)
    for number in range(before + count + 1):
        simulator.reset(number % variants, number, 9.81)
        for _ in range(3):
            simulator.step(action)
        if number >= before and (number - before) % every == 0:
            sizes.append(resident())
    pipe.send((variants, sizes))


def memory_over_resets(count: int) -> dict[str, Any]:
    """Resident MB of one environment while objects and sizes change."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    every = max(count // 10, 1)
    process = context.Process(target=_resets, args=(count, every, theirs))
    process.start()
    bodies, sizes = ours.recv()
    process.join()
    return {
        "resets": count,
        "bodies": bodies,
        "resident_mb": sizes,
        "growth_mb": sizes[-1] - sizes[0],
        "growth_kb_a_reset": (sizes[-1] - sizes[0]) * 1024 / count,
    }


def share_of_resets(rounds: int) -> dict[str, float]:
    """CPU time of one reset, and its share of an episode of 100 steps; all objects, random sizes."""
    holding = Holding(TaskConfig(objects="all", scaling="random", variants=4), 16)
    spent = []
    original = Simulator.reset

    def reset(self: Simulator, *given: Any) -> None:
        spent.append(cpu_seconds(original, self, *given))

    Simulator.reset = reset  # type: ignore[method-assign]
    try:
        total = cpu_seconds(holding.run, 100 * rounds)
    finally:
        Simulator.reset = original  # type: ignore[method-assign]
        holding.env.close()
    episode = (total - sum(spent)) / (16 * rounds) + float(np.mean(spent))
    return {
        "reset_milliseconds": float(np.mean(spent)) * 1e3,
        "share_of_full_episodes": float(np.mean(spent)) / episode,
        "episodes_ended": len(spent),
    }


def main() -> None:
    options = arguments(__doc__ or "")
    torch.set_num_threads(1)
    results = {
        "workers": workers(2 if options.quick else 10),
        "memory": memory_of_environments(3 if options.quick else 17),
        "memory_over_resets": memory_over_resets(50 if options.quick else 1000),
        "resets": share_of_resets(1 if options.quick else 2),
    }
    write("vector", results, options, ("pybullet", "numpy", "torch"))


if __name__ == "__main__":
    main()
