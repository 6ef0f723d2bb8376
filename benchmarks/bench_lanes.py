"""The compiled physics as training uses it: CPU time of a control step over lanes, beside the scalar kernel before it.

    python benchmarks/bench_lanes.py [--quick]

The shipped VecBPS oracle turns Geometric 8 in random sizes under the default randomisation, one thread. Both kernels
step copies of the same states, in turns; the scalar one is read from the history of this repository. The whole step is
that of ``CompiledSimulation``, through whole episodes, so that every environment starts a new one at least once.
"""

from __future__ import annotations

import importlib.util
import math
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from record import ROOT, Sections, arguments, write
from timing import cpu_seconds

from tactile_kit.agents import load_agent
from tactile_kit.simulation.compiled import Batch, kernel
from tactile_kit.simulation.compiled.batch import ITERATIONS
from tactile_kit.simulation.compiled.tables import hand_tables
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.vec_env import ReorientVecEnv

AGENT = ROOT / "results" / "agents" / "oracle-vec_bps-geometric8-s0"
ENVIRONMENTS = (512, 1024)
BEFORE = "1e2171d9f07c36ee5264f7afef1207dd57881d7a"  # the last revision with the scalar kernel
SCALAR = "tactile_kit/simulation/compiled/kernel.py"


class Scalar:
    """The kernel before lanes, on the states of a batch; one environment after the other, in double precision.

    Raises:
        subprocess.CalledProcessError: this is no clone with its history.
    """

    def __init__(self, folder: Path) -> None:
        text = subprocess.run(
            ["git", "show", f"{BEFORE}:{SCALAR}"], cwd=ROOT, check=True, capture_output=True, text=True
        ).stdout
        path = folder / "scalar.py"
        path.write_text(text, encoding="utf-8")
        spec = importlib.util.spec_from_file_location("scalar", path)
        assert spec is not None and spec.loader is not None
        self.kernel = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self.kernel)
        hand = hand_tables()
        names = (
            "bases", "lengths", "masses", "centres", "ball_link", "ball_at", "ball_radius", "inverse_mass", "lower",
            "upper",
        )  # fmt: skip
        self.hand = tuple(
            table if name == "ball_link" else table.astype(np.float64)
            for name, table in ((name, getattr(hand, name)) for name in names)
        )

    def step(self, batch: Batch) -> Callable[[], None]:
        """The step that ``batch`` would take next, on a copy of its state."""
        k, now = self.kernel, batch.now

        def rows(name: str) -> np.ndarray:
            return np.ascontiguousarray(np.moveaxis(getattr(now, name), -1, 0), np.float64)

        parameters = np.zeros((batch.count, k.PARAMETERS))
        for name, at in (
            ("mass", k.MASS), ("tip_friction", k.TIP_FRICTION), ("link_friction", k.LINK_FRICTION),
            ("spin_friction", k.SPIN_FRICTION), ("gravity", k.GRAVITY), ("stiffness", k.STIFFNESS), ("limit", k.LIMIT),
            ("give", k.GIVE), ("calm", k.KEEP),
        ):  # fmt: skip
            parameters[:, at] = getattr(now, name)
        for name, at in (("force", k.FORCE), ("torque", k.TORQUE), ("moments", k.MOMENTS)):
            parameters[:, at : at + 3] = rows(name)
        names = (
            "damping", "feedforward", "stick", "offset", "noise", "target", "filtered", "q", "dq", "place",
            "quaternion", "velocity", "memory", "z", "deepest",
        )  # fmt: skip
        config, grids = batch.config, batch.grids
        given = (
            np.ones(batch.count, bool), config.time_step, config.steps_per_sample,
            min(ITERATIONS, config.solver_iterations), math.exp(-config.time_step / config.filter_time_constant),
            self.hand, grids.nodes, grids.first, grids.spacing, batch.variant, parameters, *map(rows, names),
        )  # fmt: skip
        return lambda: k.control_step(0, batch.count, *given)


def environment(count: int, quick: bool) -> tuple[ReorientVecEnv, Any]:
    """The oracle's task as training plays it, and the oracle."""
    agent = load_agent(AGENT)
    settings = agent.task.model_dump()
    settings["simulation"]["engine"] = "compiled"
    sizes = {"variants": 1, "grasps": 2} if quick else {"variants": 16, "grasps": 32, "grasp_spread": 0.1}
    task = TaskConfig(**{**settings, "randomization": "default", **sizes})
    return ReorientVecEnv(task, num_envs=count, num_workers=1, seed=5), agent


def whole_steps(count: int, quick: bool) -> dict[str, Any]:
    """CPU µs of a whole step of the simulation an environment, by its parts, all threads counted."""
    env, agent = environment(count, quick)
    observation, simulation, ended = env.reset(), env.simulation, 0
    steps = 5 if quick else env.config.horizon + 20
    clock = Sections(time.process_time)
    places = {
        "begin": (simulation, "step_async"),
        "kernel": (simulation.batch, "finish"),
        "end": (simulation, "step_wait"),
        "episodes": (simulation, "_start"),
    }
    with clock.patched(places):
        for _ in range(steps):
            observation, _, done, _ = env.step(agent.act(observation))
            ended += int(done.sum())
    env.close()
    parts = {name: 1e6 * seconds / steps / count for name, seconds in clock.seconds.items()}
    return {
        "environments": count,
        "parts": parts,
        "whole": sum(parts.values()),
        "ended": ended / steps / count,
    }


def kernels(count: int, quick: bool) -> dict[str, Any]:
    """CPU µs of a control step by both kernels, in turns on the same states."""
    env, agent = environment(count, quick)
    observation, batch = env.reset(), env.simulation.batch
    lanes, scalar = [], []
    with tempfile.TemporaryDirectory() as folder:
        try:
            before: Scalar | None = Scalar(Path(folder))
        except subprocess.CalledProcessError:
            before = None
        for number in range(3 if quick else 41):
            observation, *_ = env.step(agent.act(observation))
            if number == 0 and before is not None:
                before.step(batch)()  # compiles
            if number % 2 == 0:
                continue
            if before is not None:
                scalar.append(cpu_seconds(before.step(batch)))
            batch.keep()
            lanes.append(cpu_seconds(lambda: [part() for part in batch.parts()]))
            batch.undo(np.arange(count))
    env.close()
    micro = 1e6 / count
    return {
        "environments": count,
        "lanes": micro * float(np.median(lanes)),
        "scalar": micro * float(np.median(scalar)) if scalar else None,
        "ratio": float(np.median(np.array(scalar) / np.array(lanes))) if scalar else None,
        "turns": len(lanes),
    }


def main() -> None:
    options = arguments(__doc__ or "")
    counts = (32,) if options.quick else ENVIRONMENTS
    results = {
        "agent": AGENT.name,
        "lanes": kernel.LANES,
        "kernels": kernels(counts[0], options.quick),
        "whole": [whole_steps(count, options.quick) for count in counts],
    }
    write("lanes", results, options, ("numba", "numpy"))


if __name__ == "__main__":
    main()
