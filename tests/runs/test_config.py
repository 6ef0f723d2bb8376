"""Settings of runs: presets, YAML, nearest names, differences."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from reproduce.files import ROOT
from tactile_kit.agents.config import NetworkConfig
from tactile_kit.runs import ConfigError, RunConfig, presets
from tactile_kit.runs.config import differences
from tactile_kit.task.config import TaskConfig


@pytest.mark.parametrize("name", sorted(presets()))
def test_presets_resolve_and_survive_yaml(name: str, tmp_path: Path) -> None:
    config = RunConfig.preset(name)
    path = tmp_path / "config.yaml"
    path.write_text(config.to_yaml())
    assert RunConfig.from_yaml(path) == config


def test_the_paper_preset_is_the_papers() -> None:
    config = RunConfig.preset("ppo-paper")
    assert (config.num_envs, config.ppo.minibatch) == (4096, 2**15)
    assert (config.ppo.kl_threshold, config.ppo.clip, config.ppo.entropy) == (0.016, 0.2, 1e-3)
    assert (config.ppo.gamma, config.ppo.gae_lambda, config.ppo.critic_coefficient) == (0.99, 0.95, 4.0)
    assert (config.ppo.noise_correlation, config.calm.log_std, config.ppo.critic_learning_rate) == (
        0,
        (),
        None,
    )
    layers = NetworkConfig(hidden=(512, 512, 256, 128), activation="elu", dense=True)
    assert config.ppo.actor == config.ppo.critic == layers
    assert config.played == config.task
    assert (
        config.task == TaskConfig(scaling="random")
        and config.gravity.at(0) == config.gravity.at(10**9) == 9.81
    )


def test_the_recipe_is_what_is_done_by_default() -> None:
    config = RunConfig.build({})
    assert config == RunConfig() == RunConfig.preset("ppo-compiled")
    played = config.played
    assert (played.simulation.engine, played.simulation.drag, played.action) == ("compiled", 20, "increment")
    assert config.gravity.at(0) == 0.1 and config.gravity.at(8_000_000) == 9.81


def test_short_forms_are_the_tasks() -> None:
    config = RunConfig.preset("ppo-smoke", {"encoding": "pos", "objects": "cube,apple", "seed": 3})
    assert config.task.encoding == config.encoding == "pos" and config.name == "oracle-pos-cube+apple-s3"
    with pytest.raises(ConfigError, match="encoding"):
        RunConfig.build({"encoding": "pos", "task": {"encoding": "none"}})


def test_parts_of_nested_settings_keep_the_other_defaults() -> None:
    config = RunConfig.build({"ppo": {"critic": {"hidden": [8]}}}, {"ppo.gamma": 0.9})
    assert config.ppo.critic == NetworkConfig(hidden=(8,))
    assert config.ppo.gamma == 0.9 and config.ppo.actor == RunConfig().ppo.actor


@pytest.mark.parametrize(
    ("data", "match"),
    [
        ({"stpes": 5}, "stpes: unknown; nearest valid name: 'steps'"),
        ({"ppo": {"minibach": 5}}, r"ppo\.minibach: unknown; nearest valid name: 'minibatch'"),
        ({"steps": -1}, "steps.*greater than 0.*-1"),
        ({"task": {"objekts": "cube"}}, "objects"),
        ({"gravity": {"start": 90}}, r"gravity\.start.*20"),
        ({"kind": "tactil"}, "kind.*tactil"),
    ],
)
def test_bad_settings_name_the_key(data: dict, match: str) -> None:
    with pytest.raises(ConfigError, match=match):
        RunConfig.build(data)


def test_files_that_are_no_settings_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    for text, match in (
        ("!!python/object/apply:os.system [true]", "not plain YAML"),
        ("[1, 2]", "list"),
        ("preset: ppo-smok", "ppo-smoke"),
    ):
        path.write_text(text)
        with pytest.raises(ConfigError, match=match):
            RunConfig.from_yaml(path)
    with pytest.raises(ConfigError, match="no such file"):
        RunConfig.from_yaml(tmp_path / "none.yaml")
    with pytest.raises(ConfigError, match="ppo-paper"):
        RunConfig.preset("ppo-papre")
    path.write_text(yaml.safe_dump({"preset": "ppo-smoke", "seed": 4, "ppo": {"epochs": 7}}))
    config = RunConfig.from_yaml(path)
    assert (config.seed, config.ppo.epochs, config.ppo.minibatch) == (4, 7, 512)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "is empty"),
        ("# nothing\n", "is empty"),
        ("preset: [a]", r"preset: \['a'\]; allowed is one of ppo-compiled"),
        ("preset: {a: 1}", "preset: "),
        ("ppo: {minibatch: 1}", "ppo.minibatch: .*greater than or equal to 2"),
        ("ppo: {learning_rate: .inf}", "ppo.learning_rate: .*finite"),
        ("estimator: {learning_rate: .inf}", "estimator.learning_rate: .*finite"),
        ("gravity: {start: .nan}", "gravity.start: .*finite"),
        ("calm: {log_std: [.inf]}", "calm.log_std.0: .*finite"),
        ("ppo: {actor: {hidden: [10000000, 10000000]}}", "ppo.actor.hidden.0: .*65536"),
        ("ppo: {critic: {hidden: []}}", "ppo.critic.hidden: .*at least 1"),
        ("estimator: {latent: 10000000000}", "estimator.latent: .*65536"),
        ("task: [3]\nencoding: bps", r"task: \[3\]; allowed are keys"),
        ("3: 4", "3: unknown"),
    ],
)
def test_settings_that_no_run_can_have_are_named_in_one_line(tmp_path: Path, text: str, match: str) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=match) as caught:
        RunConfig.from_yaml(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_folder_in_place_of_a_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=f"{tmp_path}: Is a directory"):
        RunConfig.from_yaml(tmp_path)


def test_differences_let_steps_grow_and_intervals_change() -> None:
    old = RunConfig.preset("ppo-smoke").to_dict()
    free = RunConfig.preset(
        "ppo-smoke", {"steps": 9000, "evaluation.minutes": 5, "checkpoint.minutes": 1, "num_workers": 2}
    )
    assert differences(old, free.to_dict()) == []
    other = RunConfig.preset("ppo-smoke", {"steps": 10, "ppo.gamma": 0.9, "num_envs": 4, "task.horizon": 7})
    lines = differences(old, other.to_dict())
    assert [line.split(":")[0] for line in lines] == ["num_envs", "ppo.gamma", "steps", "task.horizon"]
    assert "num_envs: 16 -> 4" in lines


def test_only_training_episodes_are_eased() -> None:
    config = RunConfig.build({"episodes": {"engine": "compiled", "drag": 9, "horizon": 40}})
    eased = config.played
    assert (eased.simulation.engine, eased.simulation.drag, eased.horizon) == ("compiled", 9, 40)
    assert eased.simulation.steps_per_second == config.task.simulation.steps_per_second
    assert (config.task.simulation.engine, config.task.simulation.drag) == ("bullet", 0)
    with pytest.raises(ConfigError, match="bullet"):
        RunConfig.build({"episodes": {"engine": "warp"}})
    with pytest.raises(ConfigError, match=r"drag = 20.*bullet"):
        RunConfig.build({"episodes": {"engine": "bullet", "drag": 20}})
    with pytest.raises(ConfigError, match=r"episodes.support: unknown; "):
        RunConfig.build({"episodes": {"support": 5}})


def test_gravity_rises_in_stairs_to_its_end() -> None:
    gravity = RunConfig.build(
        {"gravity": {"start": 1.0, "end": 9.81, "steps": 1000, "geometric": False}}
    ).gravity
    values = [gravity.at(step) for step in range(0, 1200)]
    assert values[0] == 1.0 and values[1000] == values[-1] == 9.81
    assert len(set(values)) == 101 and values == sorted(values)


def test_gravity_rises_by_equal_factors() -> None:
    data = {"gravity": {"start": 0.1, "end": 8.1, "steps": 1000, "geometric": True}}
    gravity = RunConfig.build(data).gravity
    assert gravity.at(0) == pytest.approx(0.1) and gravity.at(500) == pytest.approx(0.9)
    assert gravity.at(1000) == gravity.at(5000) == 8.1


def test_gravity_waits_while_too_much_is_dropped() -> None:
    gravity = RunConfig.build({"gravity": {"start": 1.0, "steps": 1000, "drops": 0.1}}).gravity
    assert gravity.after(300, 50, None) == gravity.after(300, 50, 0.1) == 350
    assert gravity.after(300, 50, 0.11) == gravity.after(300, 50, 0.2) == 300
    assert gravity.after(300, 50, 0.21) == 250 and gravity.after(30, 50, 0.9) == 0
    steady = RunConfig.build({"gravity": {"start": 1.0, "steps": 1000, "drops": 1.0}}).gravity
    assert steady.after(300, 50, 1.0) == 350


def test_settings_do_not_import_torch() -> None:
    code = (
        "import sys, tactile_kit.runs; tactile_kit.runs.RunConfig.preset('ppo-smoke'); "
        "assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


def test_settings_from_before_a_setting_existed_are_completed_with_its_default() -> None:
    from tactile_kit.runs.training import _completed

    now = RunConfig().to_dict()
    old = {name: value for name, value in now.items() if name != "episodes"}
    old["ppo"] = {name: value for name, value in now["ppo"].items() if name != "noise_correlation"}
    assert differences(old, now)
    assert differences(_completed(old), now) == []
    gone = {**old, "teapots": 3}
    assert any(line.startswith("teapots") for line in differences(_completed(gone), now))


RUNS = sorted((ROOT / "results").glob("*/*/config.yaml"))


@pytest.mark.parametrize("path", RUNS, ids=lambda path: path.parent.name)
def test_what_shipped_runs_were_trained_with_is_read_back(path: Path) -> None:
    """And to the same settings when written again: nothing that they say has lost its meaning."""
    config = RunConfig.from_yaml(path)
    given = yaml.safe_load(path.read_text())
    for part in ("task", "ppo", "episodes", "gravity"):
        assert given[part] == config.to_dict()[part]
    assert config.played.encoding == config.encoding


@pytest.mark.parametrize("path", sorted((ROOT / "results" / "agents").iterdir()), ids=lambda path: path.name)
def test_shipped_agents_load(path: Path) -> None:
    from tactile_kit.agents import load_agent

    assert load_agent(path).task.encoding == RunConfig.from_yaml(path / "config.yaml").encoding
