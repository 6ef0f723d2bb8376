"""The stages that work, by hand and for real: objects, grasps, a training of seconds, its evaluation."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import pytest

import object_sets
from reproduce.cli import main
from reproduce.files import dump_yaml, read_json
from tactile_kit.agents import load_agent
from tactile_kit.evaluation import read_rows
from tactile_kit.runs import RunConfig

pytestmark = pytest.mark.slow

RUN = "oracle-none-cube-s0"
SCALE = {
    "name": "tiny",
    "description": "One run of seconds and one episode.",
    "num_envs": 2,
    "presets": {
        "oracle": {
            "preset": "ppo-smoke",
            "steps": 160,
            "num_envs": 4,
            "log_every": 80,
            "task": {"grasps": 2, "horizon": 20},
            "episodes": {"grasps": 2},
            "ppo": {"rollout": 20, "minibatch": 40},
        }
    },
    "runs": [{"kind": "oracle", "variants": ["none"], "sets": ["cube"], "preset": "oracle"}],
    "evaluations": [
        {"name": "nominal", "runs": ["oracle-none-cube"], "objects": "cube", "goals_per_case": 1}
    ],
}


@pytest.fixture(scope="module")
def scale(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("scale") / "tiny.yaml"
    file.write_text(dump_yaml(SCALE))
    return file


def stage(name: str, out: Path, scale: Path) -> int:
    return main(["stage", name, "--scale", str(scale), "--from", "scratch", "--out", str(out)])


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory, scale: Path) -> Path:
    """Where all four stages have run."""
    folder = tmp_path_factory.mktemp("out")
    assert [stage(name, folder, scale) for name in ("objects", "grasps", "train", "evaluate")] == [0] * 4
    shutil.copy(folder / "agents" / RUN / "config.yaml", folder)
    return folder


def sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def test_markers_name_what_was_made(out: Path) -> None:
    here = out / ".pipeline"
    assert read_json(here / "objects.json")["8 cube"] == object_sets.load("all")["cube"].digest
    banks = [read_json(file) for file in (here / "grasps").iterdir()]
    assert sorted(bank["cube"] for bank in banks) == [2, 8]  # of the training, and of every evaluation
    assert read_json(here / "trained" / f"{RUN}.json") == {RUN: sha256(out / "agents" / RUN / "agent.json")}
    made = read_json(here / "evaluated" / RUN / "nominal.json")
    assert made["digest"] == sha256(out / "episodes" / RUN / "nominal.csv") and made["episodes"] == 1
    for job in ("objects", f"train/{RUN}", f"evaluate/{RUN}/nominal"):
        assert read_json(here / "progress" / f"{job}.json")["state"] == "done"


def test_the_agent_is_the_scales_and_its_row_the_evaluations(out: Path) -> None:
    agent = load_agent(out / "agents" / RUN)
    assert (agent.kind, agent.manifest.encoding, agent.manifest.steps) == ("oracle", "none", 160)
    (row,) = read_rows(out / "episodes" / RUN / "nominal.csv")
    assert (row.agent, row.object, row.given) == (RUN, "cube", "cube")


def test_a_finished_run_is_left_alone_and_another_setting_moves_it_aside(
    out: Path, scale: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = out / "agents" / RUN / "agent.json"
    before = manifest.stat().st_mtime_ns, sha256(manifest)
    assert stage("train", out, scale) == 0
    assert (manifest.stat().st_mtime_ns, sha256(manifest)) == before
    changed = json.loads(json.dumps(SCALE))
    changed["presets"]["oracle"]["steps"] = 80
    (tmp_path / "tiny.yaml").write_text(dump_yaml(changed))
    capsys.readouterr()
    assert stage("train", out, tmp_path / "tiny.yaml") == 0
    assert "settings changed (steps: 160 -> 80); the old run is now" in capsys.readouterr().out
    assert sha256(out / "agents" / ".replaced" / f"{RUN}-1" / "agent.json") == before[1]
    assert load_agent(out / "agents" / RUN).manifest.steps == 80


def test_a_run_is_trained_from_the_config_of_another(out: Path, tmp_path: Path) -> None:
    there = out / "config.yaml"
    assert main(["train", str(there), "--out", str(tmp_path / "again")]) == 0
    assert load_agent(tmp_path / "again").manifest.steps == 160
    assert RunConfig.from_yaml(tmp_path / "again" / "config.yaml") == RunConfig.from_yaml(there)


def test_a_stage_that_fails_says_so(out: Path, scale: Path, tmp_path: Path) -> None:
    """The agent of an evaluation is not there: one line, and the heartbeat of the job tells it."""
    assert stage("evaluate", tmp_path, scale) == 2
    beat = read_json(tmp_path / ".pipeline" / "progress" / "evaluate" / RUN / "nominal.json")
    assert beat["state"] == "failed" and "no agent there" in beat["message"]
