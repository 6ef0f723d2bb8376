"""Resumed equals uninterrupted, bit for bit, in the real physics."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from promise_cases import CRITIC, FIXED, RECIPE, TAUGHT, environment, settings

from tactile_kit.runs import checkpoint as checkpoints
from tactile_kit.runs import read_metrics, train, training

CLOCK = {"hours", "steps_per_second"}
HALF = 192  # environment steps: checkpoints within both halves, and roll-outs of the estimator that are cut by them


def groups(saved: checkpoints.Checkpoint) -> set[str]:
    """What kinds of state a checkpoint holds."""
    return {"/".join(name.split("/")[:2]).split(".")[0] for name in saved.tensors}


LEARNER = {"learner/policy", "learner/optimizer", "learner/noise", "env/next_episode"}
EVERYTHING = {
    "oracle": set(),
    # estimator: weights and Adam (trainer), hidden states (state), recordings (memory), and who is told the truth
    "tactile": {"env/trainer", "env/state", "env/memory", "env/truth", "env/episodes", "env/fresh"},
}  # fmt: skip


@pytest.fixture(autouse=True)
def no_checkpoint_by_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is a boundary between episodes: on a machine that is busy one more would make other episodes."""
    monkeypatch.setattr(training, "FIRST", math.inf)


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("engine", ["bullet", "compiled"])
@pytest.mark.parametrize("kind", ["tactile", "oracle"])
def test_resumed_equals_uninterrupted(tmp_path: Path, kind: str, engine: str) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"

    def play(directory: Path, steps: int, workers: int) -> None:
        config = settings(kind, steps, **RECIPE[engine])
        train(config, directory, make_env=lambda config: environment(config, workers), quiet=True)

    play(whole, 2 * HALF, 0)
    play(parts, HALF, 0)
    between = checkpoints.newest(parts / "checkpoints")[0]
    torch.rand(3), np.random.rand(3)  # whatever happens in between
    play(parts, 2 * HALF, 2)
    one, two = (checkpoints.newest(folder / "checkpoints")[0] for folder in (whole, parts))
    assert one is not None and two is not None and between is not None
    assert EVERYTHING[kind] | LEARNER <= groups(one)
    assert one.step == two.step == 2 * HALF and one.tensors.keys() == two.tensors.keys()
    different = [name for name in one.tensors if not torch.equal(one.tensors[name], two.tensors[name])]
    assert not different
    old = between.tensors
    moved = [name for name, now in one.tensors.items() if name not in old or not torch.equal(now, old[name])]
    assert {name.split("/")[1].split(".")[0] for name in moved} >= {"policy", "noise", "next_episode"}
    # random streams, adaptive rate, episode counts, what counts of the curriculum
    for name in ("learner", "tracker", "torch_rng", "env", "climbed", "calm"):
        assert one.values[name] == two.values[name], name
    for name in ("policy.safetensors", "critic.safetensors"):
        assert (whole / name).read_bytes() == (parts / name).read_bytes()
    lines, again = (
        [{name: value for name, value in line.items() if name not in CLOCK} for line in read_metrics(folder)]
        for folder in (whole, parts)
    )
    assert lines == again and [line["step"] for line in lines] == list(range(48, 2 * HALF + 1, 48))
    # it was resumed between lessons, on the curriculum's slope, and all that comes in turn had its turn
    taught = [line["step"] for line in lines if "teacher_divergence" in line]
    assert taught == list(range(FIXED + 48, TAUGHT + 1, 48)) and HALF in taught[:-1]
    assert lines[-1]["gravity"] not in (2.0, 9.81) and one.values["climbed"] < one.step
    assert one.values["learner"]["rate"] != settings(kind, 1, **RECIPE[engine]).ppo.learning_rate
    assert one.step > FIXED + CRITIC
    if kind == "tactile":
        assert lines[-1]["estimator/iteration"] > 10 and lines[-1]["rho"] == 0.0
