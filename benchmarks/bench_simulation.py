"""Cost of one control step (0.1 s of hand and held object) beside its floor, Bullet's own part of it.

    python benchmarks/bench_simulation.py [--steps-per-second 60] [--quick]

CPU milliseconds of this thread a control step, everything counted: controller, measurement, observation, reward, and
one reset in a hundred steps. The floor is the time spent inside ``stepSimulation`` in the same run, on the same states;
runs with and without the section clocks take turns. Fingers hold their grasp while commands are a little noisy.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from record import Sections, arguments, write
from timing import Holding, cpu_seconds

import object_sets
from tactile_kit.hand.controller import CommandFilter, ImpedanceController
from tactile_kit.simulation.client import Client
from tactile_kit.simulation.hand import Hand
from tactile_kit.simulation.simulator import Simulator
from tactile_kit.simulation.world import World
from tactile_kit.task import vec_env
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.observation import Observer

STEPS = 100  # control steps a block: one episode, so that every block holds one reset
SECTIONS: dict[str, tuple[Any, str]] = {
    "reset": (Simulator, "reset"),
    "torques to Bullet": (Hand, "drive"),
    "joint states from Bullet": (Hand, "read"),
    "controller and command filter": (ImpedanceController, "torques"),
    "command filter": (CommandFilter, "update"),
    "measurement": (World, "_measure"),
    "observation": (Observer, "__call__"),
    "reward": (vec_env, "reward_terms"),
}


def floor_clock(sections: Sections) -> tuple[Any, Any]:
    """``Client.__getattr__`` as it is, and one that times ``stepSimulation``."""
    original = Client.__getattr__

    def bound(self: Client, name: str) -> Any:
        value = original(self, name)
        if name == "stepSimulation":
            value = self.__dict__[name] = sections.wrap("stepSimulation", value)
        return value

    return original, bound


def timed(holding: Holding, sections: Sections, blocks: int) -> dict[str, float]:
    """Milliseconds a control step by section, mean of ``blocks`` blocks; the clocks' own cost is taken off."""
    original, bound = floor_clock(sections)
    worlds = [simulator.world for simulator in holding.env.simulation.simulators]
    for world in worlds:
        world.bullet.__dict__.pop("stepSimulation", None)
    Client.__getattr__ = bound  # type: ignore[method-assign]
    try:
        with sections.patched(SECTIONS):
            holding.run(1)
            sections.clear()
            total = sum(cpu_seconds(holding.run, STEPS) for _ in range(blocks))
    finally:
        Client.__getattr__ = original  # type: ignore[method-assign]
        for world in worlds:
            world.bullet.__dict__.pop("stepSimulation", None)
    clock = cost_of_clock()
    number = blocks * STEPS * holding.env.num_envs / 1e3
    parts = {
        name: max(seconds - sections.calls[name] * clock / 2, 0.0) / number
        for name, seconds in sections.seconds.items()
    }
    calls = sum(sections.calls.values())
    parts["all"] = (total - calls * clock) / number
    return parts


def cost_of_clock() -> float:
    """Seconds that one timed call costs, about half of them inside the measured span."""
    sections, calls = Sections(), 20_000
    nothing = sections.wrap("nothing", lambda: None)
    return min(cpu_seconds(lambda: [nothing() for _ in range(calls)]) for _ in range(5)) / calls


def milliseconds(holding: Holding, steps: int = STEPS) -> float:
    return cpu_seconds(holding.run, steps) / (steps * holding.env.num_envs) * 1e3


def of_cube(task: TaskConfig, rounds: int) -> dict[str, Any]:
    """The cube's control step, its floor, and where the time goes."""
    holding = Holding(task.model_copy(update={"objects": "cube"}), environments=16)
    try:
        plain, parts = [], []
        for _ in range(rounds):
            plain.append(milliseconds(holding))
            parts.append(timed(holding, Sections(), 1))
    finally:
        holding.env.close()
    medians = {name: float(np.median([part[name] for part in parts])) for name in parts[0]}
    medians["controller and command filter"] += medians.pop("command filter")
    total = medians.pop("all")
    medians["everything else"] = total - sum(medians.values())
    step = float(np.median(plain))
    return {
        "milliseconds": step,
        "milliseconds_best": float(np.min(plain)),
        "milliseconds_timed": total,
        "floor_share": float(np.median([part["stepSimulation"] / part["all"] for part in parts])),
        "floor_microseconds_a_physics_step": medians["stepSimulation"]
        * 1e4
        / task.simulation.steps_per_second,
        "steps_per_second_and_core": 1e3 / step,
        "steps_per_second_and_core_best": 1e3 / float(np.min(plain)),
        "sections": dict(sorted(medians.items(), key=lambda item: -item[1])),
    }


def of_objects(task: TaskConfig, rounds: int) -> dict[str, Any]:
    """Every object's control step relative to the cube's; a round is a fifth of an episode of each in turn."""
    names = [thing.name for thing in object_sets.load("all")]
    parts = {thing.name: len(thing.parts) for thing in object_sets.load("all")}
    holdings = {name: Holding(task.model_copy(update={"objects": name}), environments=4) for name in names}
    costs: dict[str, list[float]] = {name: [] for name in names}
    try:
        for _ in range(rounds):
            for name, holding in holdings.items():
                costs[name].append(milliseconds(holding, STEPS // 5))
        drops = {name: holding.drops_per_step for name, holding in holdings.items()}
    finally:
        for holding in holdings.values():
            holding.env.close()
    cube = np.array(costs["cube"])
    return {
        name: {
            "convex_parts": parts[name],
            "milliseconds": float(np.median(cost)),
            "relative_to_cube": float(np.median(np.array(cost) / cube)),
            "drops_per_100_steps": 100 * drops[name],
        }
        for name, cost in costs.items()
    }


def main() -> None:
    options = arguments(
        __doc__ or "", lambda parser: parser.add_argument("--steps-per-second", type=int, default=60)
    )
    torch.set_num_threads(1)
    task = TaskConfig(simulation={"steps_per_second": options.steps_per_second})
    results = {
        "settings": task.simulation.model_dump() | {"randomization": task.randomization},
        "cube": of_cube(task, 1 if options.quick else 5),
        "objects": of_objects(task, 1 if options.quick else 15),
    }
    write("simulation", results, options, ("pybullet", "numpy", "numba", "torch"))


if __name__ == "__main__":
    main()
