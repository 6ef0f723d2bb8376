"""The compiled physics beside Bullet: what a control step costs, and how far the two come apart.

    python benchmarks/bench_compiled.py [--grasps 16] [--quick]

The paper's objects at nominal size, no randomisation. All start from the same grasps and get the same commands, which
wander from the grasp's by a random walk; sums of episodes, object by object and all together. How far Bullet at
1/240 s comes apart from Bullet at 1/60 s is the yardstick: so much depends on the step alone.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from record import arguments, write

import object_sets
import randomization
from tactile_kit.evaluation.intervals import wilson
from tactile_kit.hand import kinematics
from tactile_kit.rotations import geodesic
from tactile_kit.shape import MeshTable
from tactile_kit.simulation.banks import BulletFinder, find_banks
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.compiled import CompiledSimulation
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.episode import FULL_RANGE, MIDDLE, Status
from tactile_kit.simulation.vector import Blueprint, VectorSimulation

STEPS = 30  # control steps
WALK = 0.06  # rad a joint and control step
AT = (5, 10, 20, 30)
SETTINGS: dict[str, dict[str, Any]] = {
    "compiled": {"engine": "compiled"},
    "bullet": {},
    "bullet_240": {"steps_per_second": 240},
}


class Scenes:
    """Objects, grasps and commands that all settings share."""

    def __init__(self, grasps: int) -> None:
        self.things = object_sets.select("paper")
        self.bodies = [Body(thing) for thing in self.things]
        self.meshes = MeshTable.from_meshes([(thing.vertices, thing.faces) for thing in self.things])
        self.bank = find_banks(BulletFinder(grasps, SimulationConfig()), [[thing] for thing in self.things])[
            1
        ]
        self.count = grasps * len(self.things)
        self.object = np.arange(self.count) % len(self.things)
        walk = randomization.stream(0, "benchmark", "walk").normal(
            size=(STEPS, self.count, kinematics.JOINTS)
        )
        self.walk = WALK * np.cumsum(walk, axis=0)

    def play(self, settings: dict[str, Any]) -> dict[str, np.ndarray]:
        """Poses ``x (T + 1, N, 3)``, ``R``, ``over (T + 1, N)`` whether the episode has ended, and ``cpu`` s a step."""
        config = SimulationConfig(**settings)
        blueprint = Blueprint(config, self.bodies, self.bank, randomization.preset("none"), STEPS + 1)
        compiled = config.engine == "compiled"
        simulation: Any = (
            CompiledSimulation(blueprint, self.meshes, self.count, 1)
            if compiled
            else VectorSimulation(blueprint, self.count, 0)
        )
        views = simulation.views
        views["next_variant"][:], views["next_seed"][:] = self.object, np.arange(self.count)
        views["next_gravity"][:] = randomization.STANDARD_GRAVITY
        simulation.reset()
        start = views["z0"].reshape(self.count, 6, 2, kinematics.JOINTS)[:, -1].sum(axis=1)
        over = np.zeros(self.count, bool)
        rows = [(views["x0"].copy(), views["R0"].copy(), over)]
        began = time.process_time()
        for step in self.walk:
            views["action"][:] = np.clip((start + step - MIDDLE) / FULL_RANGE, -1, 1)
            simulation.step_async()
            simulation.step_wait()
            over = over | (views["status"] != Status.RUNNING)
            rows.append((views["x"].copy(), views["R"].copy(), over))
        seconds = time.process_time() - began
        simulation.close()
        x, R, ended = (np.stack(column) for column in zip(*rows, strict=True))
        return {"x": x, "R": R, "over": ended, "cpu": np.array(seconds / STEPS / self.count)}


def apart(
    one: dict[str, np.ndarray], other: dict[str, np.ndarray], at: int, which: np.ndarray
) -> dict[str, Any]:
    """Medians after ``at`` steps over the episodes ``which`` that both still hold, and how often the ends agree."""
    held = which & ~one["over"][at] & ~other["over"][at]
    distance = np.linalg.norm(one["x"][at] - other["x"][at], axis=1)[held]
    moved = np.linalg.norm(other["x"][at] - other["x"][0], axis=1)[held]
    return {
        "seconds": at / 10,
        "held": int(held.sum()),
        "moved_mm": 1e3 * float(np.median(moved)),
        "apart_mm": 1e3 * float(np.median(distance)),
        "turned": float(np.median(geodesic(other["R"][at], other["R"][0])[held])),
        "apart": float(np.median(geodesic(one["R"][at], other["R"][at])[held])),
        "agree": float((one["over"][at] == other["over"][at])[which].mean()),
    }


def rate(ended: np.ndarray) -> dict[str, Any]:
    low, high = wilson(int(ended.sum()), len(ended))
    return {"rate": float(ended.mean()), "low": low, "high": high, "n": len(ended)}


def main() -> None:
    options = arguments(__doc__ or "", lambda p: p.add_argument("--grasps", type=int, default=16))
    scenes = Scenes(2 if options.quick else options.grasps)
    for settings in SETTINGS.values():  # compile and warm up
        if options.quick or settings.get("engine") == "compiled":
            scenes.play(settings)
    runs = {name: scenes.play(settings) for name, settings in SETTINGS.items()}
    everything = np.ones(scenes.count, bool)
    pairs = {"compiled": ("compiled", "bullet"), "bullet_240": ("bullet_240", "bullet")}
    results = {
        "cpu_microseconds": {name: 1e6 * float(run["cpu"]) for name, run in runs.items()},
        "ended": {name: rate(run["over"][-1]) for name, run in runs.items()},
        "apart": {
            name: [apart(runs[a], runs[b], at, everything) for at in AT] for name, (a, b) in pairs.items()
        },
        "objects": [
            {
                "object": thing.name,
                **{name: rate(run["over"][-1][scenes.object == index]) for name, run in runs.items()},
                "apart": apart(runs["compiled"], runs["bullet"], 10, scenes.object == index),
            }
            for index, thing in enumerate(scenes.things)
        ],
    }
    write("compiled", results, options, ("pybullet", "numba", "numpy"))


if __name__ == "__main__":
    main()
