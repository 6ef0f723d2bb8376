"""Trains on the toy task in a process of its own, to be killed: ``python toy_run.py DIRECTORY STEPS``."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "agents"))

from toy_task import ToyEnv

from tactile_kit.runs import RunConfig, train

EVERY = 512  # steps between checkpoints


def settings(steps: int, **changes) -> RunConfig:
    tiny = {"hidden": (24, 16)}
    base = {
        "encoding": "none",
        "steps": steps,
        "num_envs": 8,
        "ppo": {"actor": tiny, "critic": tiny, "rollout": 16, "minibatch": 64},
        "log_every": 256,
        "checkpoint.steps": EVERY,
        "checkpoint.minutes": 1e6,
        "start_at_grasp": False,
        "gravity": {"start": 1.0, "end": 9.81, "steps": 2000, "drops": 1.0, "geometric": False},
    }
    return RunConfig.preset("ppo-smoke", {**base, **changes})


def toy(config: RunConfig) -> ToyEnv:
    return ToyEnv(config.num_envs, seed=config.seed, drop=0.02)


if __name__ == "__main__":
    train(settings(int(sys.argv[2])), sys.argv[1], make_env=toy, quiet="--quiet" in sys.argv)
