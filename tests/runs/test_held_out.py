"""Held-out evaluations of the real task: between two iterations of a training, and once at its end."""

from __future__ import annotations

from pathlib import Path

import pytest

from tactile_kit.agents import load_agent
from tactile_kit.runs import RunConfig, read_metrics, train

pytestmark = pytest.mark.slow


def test_evaluations_while_training_and_at_its_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tiny = {"hidden": (16,)}
    config = RunConfig.preset(
        "ppo-smoke",
        {
            "steps": 24, "num_envs": 12, "encoding": "none", "log_every": 12, "start_at_grasp": False,
            "task": {"objects": "cube", "grasps": 2, "horizon": 20}, "episodes": {"grasps": 2},
            "ppo": {"rollout": 1, "minibatch": 12, "actor": tiny, "critic": tiny},
            "evaluation": {"minutes": 1e-6, "at_end": True, "num_envs": 24, "steps": 20, "episodes": 32},
        },
    )  # fmt: skip
    train(config, tmp_path)
    lines = [line for line in read_metrics(tmp_path) if line.get("evaluation")]
    assert [line["step"] for line in lines] == [12, 24]
    for line in lines:
        assert line["episodes"] == 24 and 0 <= line["success_rate"] <= 1 - line["drops"] and line["theta"] > 0
    (point,) = [line for line in read_metrics(tmp_path) if "held_out/success" in line]
    assert point["step"] == 24 and point["held_out/episodes"] == 32  # the first iteration beyond 20
    assert 0 <= point["held_out/success"] <= 1 - point["held_out/drops"]
    assert capsys.readouterr().err.count("evaluation: success rate") == 2
    assert load_agent(tmp_path).manifest.steps == 24
    train(config, tmp_path)  # finished and evaluated: nothing is left to do
    assert len(read_metrics(tmp_path)) == len(lines) + 3
    assert "evaluation" not in capsys.readouterr().err
