"""Samples a second of the learners end to end, where the time goes, and what bfloat16 brings and costs.

    python benchmarks/bench_learners.py [--seconds 40] [--quick]

Presets ``ppo-small`` and ``sac-small`` on the cube at nominal size, wall time of the learning process. A gradient step
in float32 and bfloat16: CPU time, in turns, same data. Learning curves in both: the tests' toy task (a body that turns
as commanded, no physics), several seeds; it shows whether learning breaks, not more.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import torch
from record import Sections, arguments, from_tests, write
from timing import cpu_seconds

from tactile_kit.agents.config import NetworkConfig, PPOConfig, SACConfig
from tactile_kit.agents.ppo import PPO
from tactile_kit.agents.sac import SAC
from tactile_kit.runs.config import RunConfig
from tactile_kit.runs.metrics import Tracker
from tactile_kit.runs.training import default_env, make_learner

# name: (precision of float32 products, bfloat16 autocast)
PRECISIONS = {
    "float32": ("highest", False),
    "float32, precision medium": ("medium", False),
    "bfloat16": ("medium", True),
}


def preset(algorithm: str) -> RunConfig:
    changes = {"objects": "cube", "scaling": "nominal", "sac.warmup": 640, "sac.capacity": 50_000}
    return RunConfig.preset(f"{algorithm}-small", changes)


def end_to_end(algorithm: str, seconds: float) -> dict[str, Any]:
    """Samples a second, and shares of the learning process's wall time."""
    config = preset(algorithm)
    torch.set_num_threads(config.torch_threads)
    torch.set_float32_matmul_precision(config.matmul_precision)
    env = default_env(config)
    try:
        learner = make_learner(config, env)
        tracker = Tracker()
        learner._setup_learn(10**9, tracker)
        for _ in range(25 if algorithm == "sac" else 1):  # past the warm-up
            learner.iterate(tracker)
        sections = Sections(time.perf_counter)
        places = {
            "learning": (learner, "train"),
            "observation, reward, bookkeeping": (env, "step_wait"),
            "waiting for the simulators": (env.simulation, "step_wait"),
        }
        if algorithm == "sac":
            places |= {"inference": (learner, "explore"), "storing": (learner.replay_buffer, "add")}
        else:
            places |= {"inference": (learner, "_look")}
        before, begin = learner.num_timesteps, time.perf_counter()
        with sections.patched(places):
            while time.perf_counter() - begin < seconds:
                learner.iterate(tracker)
        taken = time.perf_counter() - begin
        samples = learner.num_timesteps - before
    finally:
        env.close()
    shares = {name: value / taken for name, value in sections.seconds.items()}
    shares["everything else"] = 1 - sum(shares.values())
    return {
        "environments": config.num_envs,
        "workers": config.num_workers,
        "threads": config.threads,
        "samples": samples,
        "samples_per_second": samples / taken,
        "updates_per_sample": (config.sac.updates / config.num_envs) if algorithm == "sac" else None,
        "shares": dict(sorted(shares.items(), key=lambda item: -item[1])),
    }


def gradient_steps(algorithm: str, rounds: int) -> dict[str, float]:
    """CPU milliseconds a gradient step by precision; one thread, same network and data."""
    torch.set_num_threads(1)
    learners = {}
    env = default_env(preset(algorithm).model_copy(update={"num_workers": 0}))
    try:
        for name, (_, bfloat16) in PRECISIONS.items():
            config = preset(algorithm)
            part = getattr(config, algorithm).model_copy(update={"bfloat16": bfloat16})
            learner = make_learner(config.model_copy(update={algorithm: part}), env)
            tracker = Tracker()
            learner._setup_learn(10**9, tracker)
            if learners:
                first = next(iter(learners.values()))
                if algorithm == "sac":
                    learner.replay_buffer = first.replay_buffer
                else:
                    learner.rollout_buffer = first.rollout_buffer
            elif algorithm == "sac":
                for _ in range(60):
                    learner.iterate(tracker)
            else:
                learner.collect_rollouts(env, tracker, learner.rollout_buffer, learner.n_steps)
            learners[name] = learner
        times: dict[str, list[float]] = {name: [] for name in learners}
        for _ in range(rounds):
            for name, learner in learners.items():
                torch.set_float32_matmul_precision(PRECISIONS[name][0])
                before = learner._n_updates
                given = (10,) if algorithm == "sac" else ()
                taken = cpu_seconds(learner.train, *given)
                times[name].append(taken / (learner._n_updates - before) * 1e3)
    finally:
        env.close()
        torch.set_float32_matmul_precision("highest")
    return {name: float(np.median(values)) for name, values in times.items()}


def toy_curve(algorithm: str, precision: str, seed: int, iterations: int) -> float:
    """Mean final angle (rad) of the last fifth of the episodes on the toy task."""
    toy = from_tests("agents/toy_task.py")
    name, bfloat16 = PRECISIONS[precision]
    torch.set_float32_matmul_precision(name)  # type: ignore[arg-type]
    network = NetworkConfig(hidden=(256, 256), activation="relu", dense=False)
    if algorithm == "sac":
        critic = network.model_copy(update={"layer_norm": True})
        settings = SACConfig(
            capacity=40_000, batch=256, warmup=400, learning_rate=1e-3, actor=network, critic=critic,
            bfloat16=bfloat16,
        )  # fmt: skip
        learner: Any = SAC(toy.ToyEnv(16, seed=1 + seed), settings, seed=seed)
    else:
        ppo = PPOConfig(rollout=32, minibatch=256, actor=network, critic=network, bfloat16=bfloat16)
        learner = PPO(toy.ToyEnv(32, seed=1 + seed), ppo, seed=seed)
    angles: list[float] = []

    class Angles(Tracker):
        def _on_step(self) -> bool:
            angles.extend(info["theta"] for info in self.locals["infos"] if "theta" in info)
            return super()._on_step()

    tracker = Angles()
    learner._setup_learn(10**9, tracker)
    for _ in range(iterations):
        learner.iterate(tracker)
    torch.set_float32_matmul_precision("highest")
    return float(np.mean(angles[-len(angles) // 5 :]))


def learning_curves(seeds: int, quick: bool) -> dict[str, Any]:
    """Final angles by precision, one a seed, and the paired difference with its standard error."""
    torch.set_num_threads(1)
    result: dict[str, Any] = {}
    for algorithm, iterations in (("sac", 400), ("ppo", 30)):
        finals = {
            precision: [
                toy_curve(algorithm, precision, seed, 30 if quick else iterations) for seed in range(seeds)
            ]
            for precision in ("float32", "bfloat16")
        }
        difference = np.array(finals["bfloat16"]) - np.array(finals["float32"])
        error = float(difference.std(ddof=1) / np.sqrt(seeds)) if seeds > 1 else None
        result[algorithm] = {
            "final_angle_rad": finals,
            "difference_rad": float(difference.mean()),
            "standard_error_rad": error,
        }
    return result


def main() -> None:
    options = arguments(
        __doc__ or "",
        lambda parser: parser.add_argument(
            "--seconds", type=float, default=40, help="of each end-to-end run", metavar="S"
        ),
    )
    seconds = 3 if options.quick else options.seconds
    results = {
        "end_to_end": {name: end_to_end(name, seconds) for name in ("ppo", "sac")},
        "gradient_step_milliseconds": {
            name: gradient_steps(name, 1 if options.quick else 9) for name in ("ppo", "sac")
        },
        "toy_task": learning_curves(1 if options.quick else 6, options.quick),
    }
    write("learners", results, options, ("torch", "stable-baselines3", "numpy", "pybullet"))


if __name__ == "__main__":
    main()
