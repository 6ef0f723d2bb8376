"""Resumed equals uninterrupted, bit for bit, in the real physics."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from promise_cases import RECIPE, settings

from tactile_kit.ecrl import TactileVecEnv
from tactile_kit.runs import RunConfig, read_metrics, train
from tactile_kit.runs import checkpoint as checkpoints
from tactile_kit.task.vec_env import ReorientVecEnv

HALF = 192  # environment steps: checkpoints within both halves, and roll-outs of the estimator that are cut by them


def environment(workers: int) -> Callable[[RunConfig], Any]:
    """Builds the environment of a run's settings over so many worker processes (0: in this process)."""

    def make(config: RunConfig) -> Any:
        common = {"num_envs": config.num_envs, "num_workers": workers, "seed": 11}
        if config.kind == "oracle":
            return ReorientVecEnv(config.played, **common)
        return TactileVecEnv(config.played, **common, estimator=config.estimator, ecrl=config.ecrl)

    return make


def groups(saved: checkpoints.Checkpoint) -> set[str]:
    """What kinds of state a checkpoint holds."""
    return {"/".join(name.split("/")[:2]).split(".")[0] for name in saved.tensors}


LEARNER = {"learner/policy", "learner/optimizer", "learner/noise", "env/next_episode"}
EVERYTHING = {
    "oracle": set(),
    # estimator: weights and Adam (trainer), hidden states (state), recordings (memory), and who is told the truth
    "tactile": {"env/trainer", "env/state", "env/memory", "env/truth", "env/episodes", "env/fresh"},
}  # fmt: skip


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("engine", ["bullet", "compiled"])
@pytest.mark.parametrize("kind", ["tactile", "oracle"])
def test_resumed_equals_uninterrupted(tmp_path: Path, kind: str, engine: str) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    recipe = RECIPE[engine]
    train(settings(kind, 2 * HALF, **recipe), whole, make_env=environment(0), quiet=True)
    train(settings(kind, HALF, **recipe), parts, make_env=environment(0), quiet=True)
    between = checkpoints.newest(parts / "checkpoints")[0]
    torch.rand(3), np.random.rand(3)  # whatever happens in between
    train(settings(kind, 2 * HALF, **recipe), parts, make_env=environment(2), quiet=True)
    one, two = (checkpoints.newest(folder / "checkpoints")[0] for folder in (whole, parts))
    assert one is not None and two is not None and between is not None
    assert EVERYTHING[kind] | LEARNER <= groups(one)
    assert one.step == two.step == 2 * HALF and one.tensors.keys() == two.tensors.keys()
    different = [name for name in one.tensors if not torch.equal(one.tensors[name], two.tensors[name])]
    assert not different
    moved = [
        name
        for name in one.tensors
        if not torch.equal(one.tensors[name], between.tensors.get(name, torch.nan))
    ]
    assert {name.split("/")[1].split(".")[0] for name in moved} >= {"policy", "noise", "next_episode"}
    for name in ("learner", "tracker", "torch_rng", "env"):  # random streams, adaptive rate, episode counts
        assert one.values[name] == two.values[name], name
    for name in ("policy.safetensors", "critic.safetensors"):
        assert (whole / name).read_bytes() == (parts / name).read_bytes()
    last, again = read_metrics(whole)[-1], read_metrics(parts)[-1]
    clock = {"hours", "steps_per_second"}
    assert {k: v for k, v in last.items() if k not in clock} == {
        k: v for k, v in again.items() if k not in clock
    }
    assert last["gravity"] not in (2.0, 9.81)  # resumed on the curriculum's slope
    if kind == "tactile":
        assert last["estimator/iteration"] > 10 and last["rho"] == 0.0
    assert one.values["learner"]["rate"] != settings(kind, 1, **recipe).ppo.learning_rate
