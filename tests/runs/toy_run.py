"""Trains on the toy task in a process of its own, to be killed: ``python toy_run.py DIRECTORY ALGORITHM STEPS``."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "agents"))

from toy_task import ToyEnv

from tactile_kit.runs import RunConfig, train

EVERY = {"sac": 480, "ppo": 512}  # steps between checkpoints


def settings(algorithm: str, steps: int, **changes) -> RunConfig:
    tiny = {"hidden": (24, 16)}
    learner = {"actor": tiny, "critic": tiny}
    learner |= (
        {"capacity": 800, "batch": 32, "warmup": 64}
        if algorithm == "sac"
        else {"rollout": 16, "minibatch": 64}
    )
    base = {
        "encoding": "none",
        "steps": steps,
        "num_envs": 8,
        algorithm: learner,
        "log_every": 256,
        "checkpoint.steps": EVERY[algorithm],
        "checkpoint.minutes": 1e6,
        "start_at_grasp": False,
        "gravity": {"start": 1.0, "end": 9.81, "steps": 2000},
    }
    return RunConfig.preset(f"{algorithm}-smoke", {**base, **changes})


def toy(config: RunConfig) -> ToyEnv:
    return ToyEnv(config.num_envs, seed=config.seed, drop=0.02)


if __name__ == "__main__":
    train(settings(sys.argv[2], int(sys.argv[3])), sys.argv[1], make_env=toy, quiet="--quiet" in sys.argv)
