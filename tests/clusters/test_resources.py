"""What jobs ask for: enough for their own settings, by what was measured."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from reproduce import resources
from reproduce.files import ROOT
from reproduce.plan import make_plan
from reproduce.prepare import prepare, weight
from reproduce.scales import load_scale
from tactile_kit.runs.config import RunConfig


def measured(name: str) -> dict:
    return json.loads((ROOT / "results" / "benchmarks" / f"{name}.json").read_text())


def test_costs_are_the_measured_ones() -> None:
    assert pytest.approx(1e3 * measured("simulation")["cube"]["milliseconds"], rel=0.15) == resources.BULLET
    assert pytest.approx(measured("compiled")["cpu_microseconds"]["compiled"], rel=0.15) == resources.COMPILED
    memory = measured("vector")["memory"]
    assert pytest.approx(memory["first_mb"], rel=0.15) == resources.WORKER
    assert pytest.approx(memory["each_further_mb"], rel=0.15) == resources.ENVIRONMENT


@pytest.mark.parametrize("kind", ["oracle", "tactile"])
def test_the_learners_parts_are_the_measured_ones(kind: str) -> None:
    found = measured("cluster")["learners"][kind]
    config = RunConfig.preset("ppo-paper", {"kind": kind, "threads": 1}).to_dict()
    parts = resources.step_parts(config)
    learner = found["parts"]["update"] + found["parts"].get("estimator's updates", 0.0)
    assert parts.learner == pytest.approx(learner, rel=0.25)
    assert parts.parent == pytest.approx(sum(found["parts"].values()) - learner, rel=0.4)
    assert found["resident_mb"] < resources.training(config).mem_mb


def test_a_training_asks_for_what_its_settings_need() -> None:
    config = RunConfig.preset("ppo-paper").to_dict()
    need = resources.training(config)
    assert need.threads == config["num_workers"] == 64
    assert need.mem_mb > 64 * 216 + (4096 - 64) * 29
    assert need.minutes > config["steps"] * 842e-6 / 64 / 60
    fewer = resources.training(RunConfig.preset("ppo-paper", {"num_envs": 1024, "num_workers": 32}).to_dict())
    assert fewer.threads == 32 and fewer.mem_mb < 0.4 * need.mem_mb and fewer.minutes > need.minutes
    compiled = resources.training(RunConfig.preset("ppo-compiled").to_dict())
    assert compiled.mem_mb < 4000 and compiled.threads == 2
    both = need | compiled
    assert both == resources.Need(64, need.mem_mb, need.minutes + compiled.minutes)


@pytest.mark.slow
def test_the_scale_paper_fits_its_own_requests(tmp_path: Path) -> None:
    plan = make_plan(load_scale("paper"), "scratch", tmp_path)
    content = json.loads(prepare(plan).read_text())
    assert len(content["train"]) == len(plan.runs)
    for job in content["train"].values():
        assert job["threads"] == 64 and job["mem_mb"] > 100_000 and job["minutes"] > 60
    for evaluation in plan.evaluations:
        job = content["evaluate"][evaluation.name]
        assert job["threads"] == plan.scale.num_workers
        assert job["mem_mb"] > plan.scale.num_envs * resources.ENVIRONMENT
        assert job["minutes"] > weight(evaluation) * resources.EPISODE / job["threads"] / 60
    assert all(job["threads"] == plan.scale.num_workers for job in content["grasps"].values())
