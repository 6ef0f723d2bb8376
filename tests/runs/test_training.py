"""Runs: what is left in the directory, exact resume, signals, locks, damaged checkpoints, refusals."""

from __future__ import annotations

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from toy_run import settings, toy
from toy_task import ToyEnv

from tactile_kit.agents import load_agent
from tactile_kit.runs import (
    CheckpointError,
    ConfigError,
    LockedError,
    RunConfig,
    finished,
    read_metrics,
    train,
)
from tactile_kit.runs import checkpoint as checkpoints
from tactile_kit.runs.directory import locked
from tactile_kit.runs.starting import lost

SCRIPT = Path(__file__).parent / "toy_run.py"


def run(directory: Path, steps: int, **changes) -> Path:
    return train(settings(steps, **changes), directory, make_env=toy, quiet=True)


def last(directory: Path) -> checkpoints.Checkpoint:
    saved, messages = checkpoints.newest(directory / "checkpoints")
    assert saved is not None and not messages
    return saved


def assert_same(a: checkpoints.Checkpoint, b: checkpoints.Checkpoint) -> None:
    assert a.step == b.step and a.tensors.keys() == b.tensors.keys()
    for name, tensor in a.tensors.items():
        assert torch.equal(tensor, b.tensors[name]), name
    assert a.values["learner"] == b.values["learner"]
    assert a.values["tracker"] == b.values["tracker"]


def test_a_run_leaves_torch_as_it_was(tmp_path: Path) -> None:
    """What the process computes afterwards is rounded as before, also when the run failed."""

    def now() -> tuple[int, str]:
        return torch.get_num_threads(), torch.get_float32_matmul_precision()

    def fail(config: RunConfig) -> ToyEnv:
        assert now() == (1, "medium")
        raise OSError("no environment")

    one_thread = torch.get_num_threads()
    torch.set_num_threads(2)
    before = now()
    assert before[1] == "highest"
    run(tmp_path / "whole", 128, threads=2, matmul_precision="medium")
    assert now() == before
    with pytest.raises(OSError, match="no environment"):
        train(
            settings(128, threads=2, matmul_precision="medium"),
            tmp_path / "failed",
            make_env=fail,
            quiet=True,
        )
    assert now() == before
    torch.set_num_threads(one_thread)


def test_a_run_leaves_an_agent_and_its_history(tmp_path: Path) -> None:
    run(tmp_path, 1024)
    assert finished(tmp_path)
    assert RunConfig.from_yaml(tmp_path / "config.yaml") == settings(1024)
    lines = read_metrics(tmp_path)
    assert [line["step"] for line in lines] == [256, 512, 768, 1024]
    for key in (
        "hours",
        "success",
        "theta",
        "drops",
        "reward",
        "steps_per_second",
        "gravity",
        "reward_rotation",
    ):
        assert all(key in line for line in lines)
    assert lines[0]["gravity"] < lines[-1]["gravity"] < 9.81
    agent = load_agent(tmp_path)
    assert agent.manifest.steps == 1024 and agent.manifest.training["step"] == 1024
    card = (tmp_path / "README.md").read_text()
    assert "barely trained" in card and "1,024 environment steps" in card and "not been evaluated" in card
    assert any((tmp_path / "tensorboard").iterdir())
    assert len(list((tmp_path / "checkpoints").iterdir())) == 2
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.name != ".lock"}
    run(tmp_path, 1024)  # nothing left to do
    assert before == {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.name != ".lock"}


def test_whole_rollouts_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    train(settings(1000), tmp_path, make_env=toy)
    assert "1,024/1,024 steps" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("wait, steps", [(0.0, [128, 1024]), (60.0, [1024])])
def test_the_first_checkpoint_comes_early(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wait: float, steps: list[int]
) -> None:
    monkeypatch.setattr("tactile_kit.runs.training.FIRST", wait)
    run(tmp_path, 1024, **{"checkpoint.steps": 0})
    assert [int(path.name.split("-")[1]) for path in checkpoints.listing(tmp_path / "checkpoints")] == steps


def test_what_was_lost_is_told(tmp_path: Path) -> None:
    run(tmp_path, 512)
    saved = last(tmp_path)
    assert lost(tmp_path, saved, "") == ""
    assert lost(tmp_path, saved, "process 7").startswith("process 7 was killed here: what it did since")
    with (tmp_path / "metrics.jsonl").open("a") as file:
        file.write(json.dumps({"step": 1512, "hours": saved.values["hours"] + 0.5003}) + "\n")
    said = lost(tmp_path, saved, "")
    assert "before it could save: at least 1,000 steps (30:01) after 512 are lost" in said
    assert "at least 1,512 steps" in lost(tmp_path, None, "process 7")


def test_a_kill_between_checkpoint_and_export_is_made_good(tmp_path: Path) -> None:
    run(tmp_path, 512)
    whole = {name: (tmp_path / name).read_bytes() for name in ("agent.json", "policy.safetensors")}
    older = json.loads(whole["agent.json"]) | {"steps": 240, "weights": {"policy.safetensors": "0"}}
    (tmp_path / "agent.json").write_text(json.dumps(older))
    run(tmp_path, 512)
    assert {name: (tmp_path / name).read_bytes() for name in whole} == whole


def test_resumed_equals_uninterrupted(tmp_path: Path) -> None:
    half = 1024
    run(tmp_path / "a", 2 * half)
    run(tmp_path / "b", half)
    torch.rand(7)  # whatever happens in between
    run(tmp_path / "b", 2 * half)
    assert_same(last(tmp_path / "a"), last(tmp_path / "b"))
    for name in ("policy.safetensors", "critic.safetensors"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    lines, again = ({line["step"]: line for line in read_metrics(tmp_path / name)} for name in "ab")
    again.pop(half, None)  # the end of the first part
    assert lines.keys() - {half} == again.keys()
    for step, line in again.items():
        for key in ("success", "theta", "drops", "reward", "episodes", "gravity", "updates"):
            assert line.get(key) == lines[step].get(key), (step, key)
    third = settings(2 * half, seed=1)
    train(third, tmp_path / "c", make_env=toy, quiet=True)
    assert (tmp_path / "a/policy.safetensors").read_bytes() != (
        tmp_path / "c/policy.safetensors"
    ).read_bytes()


def test_resumed_equals_uninterrupted_with_two_threads(tmp_path: Path) -> None:
    """The parts of a batch, not their order in time, decide the bits; and torch itself divides nothing."""
    seen = []

    def watched(config: RunConfig) -> ToyEnv:
        seen.append(torch.get_num_threads())
        return toy(config)

    for name, steps in (("whole", 1024), ("parts", 512), ("parts", 1024)):
        train(settings(steps, threads=2), tmp_path / name, make_env=watched, quiet=True)
    assert_same(last(tmp_path / "whole"), last(tmp_path / "parts"))
    assert seen == [1, 1, 1]


def spawn(directory: Path, steps: int) -> subprocess.Popen:
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, str(SCRIPT), str(directory), str(steps)],
        env=environment, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def wait_for_checkpoints(directory: Path, process: subprocess.Popen, count: int, limit: float = 120) -> None:
    end = time.monotonic() + limit
    while len(list((directory / "checkpoints").glob("step-*"))) < count:
        assert process.poll() is None and time.monotonic() < end, process.stderr.read()
        time.sleep(0.02)


def kills(tmp_path: Path, count: int, steps: int, seed: int = 0) -> None:
    """Kill a run ``count`` times at random moments, let it finish, and compare it with one never killed."""
    draw = random.Random(seed)
    directory, during = tmp_path / "killed", 0
    for _ in range(count):
        process = spawn(directory, steps)
        before = checkpoints.listing(directory / "checkpoints")
        while process.poll() is None:  # until it has saved once more, then a moment longer
            if checkpoints.listing(directory / "checkpoints") != before:
                break
            time.sleep(0.01)
        time.sleep(draw.uniform(0, 0.4))
        process.kill()
        process.wait()
        process.stderr.close()
        last(directory)  # whole, without falling back
        during += any(
            re.search(r"/\.writing-|\.next$|/\.[^/]+\.\w{8}$", str(path)) for path in directory.rglob("*")
        )
        if (directory / "agent.json").exists():
            load_agent(directory)
    print(f"{count} kills, {during} of them during a save")
    process = spawn(directory, steps)
    _, errors = process.communicate(timeout=280)
    assert process.returncode == 0, errors
    run(tmp_path / "whole", steps)
    assert_same(last(tmp_path / "whole"), last(directory))
    load_agent(directory)


def test_killed_runs_continue_exactly(tmp_path: Path) -> None:
    kills(tmp_path, 2, 5120)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_killed_many_times(tmp_path: Path) -> None:
    kills(tmp_path, 12, 26_624, seed=1)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_save_and_leave(tmp_path: Path, number: int) -> None:
    process = spawn(tmp_path, 10_000_000)
    wait_for_checkpoints(tmp_path, process, 1)
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 0 and "run again to continue" in errors
    stopped = last(tmp_path).step
    assert load_agent(tmp_path).manifest.steps == stopped and not finished(tmp_path)


def test_a_second_job_is_refused_while_the_first_lives(tmp_path: Path) -> None:
    process = spawn(tmp_path, 10_000_000)
    try:
        wait_for_checkpoints(tmp_path, process, 1)
        with pytest.raises(LockedError, match=f"process {process.pid}"):
            run(tmp_path, 10_000_000)
    finally:
        process.kill()
        process.communicate()
    with locked(tmp_path), pytest.raises(LockedError), locked(tmp_path):
        pass
    with locked(tmp_path):
        pass


@pytest.mark.parametrize("damage", ["truncated tensors", "no json", "json cut", "json changed", "empty"])
def test_a_damaged_checkpoint_falls_back_to_the_one_before(
    tmp_path: Path, damage: str, capsys: pytest.CaptureFixture
) -> None:
    run(tmp_path, 1280)
    old, new = checkpoints.listing(tmp_path / "checkpoints")
    state, tensors = new / "state.json", new / "state.safetensors"
    if damage == "truncated tensors":
        tensors.write_bytes(tensors.read_bytes()[:-100])
    elif damage == "no json":
        state.unlink()
    elif damage == "json cut":
        state.write_text(state.read_text()[:500])
    elif damage == "json changed":
        state.write_text(state.read_text().replace('"updates": ', '"updates": 1'))
    else:
        for path in new.iterdir():
            path.unlink()
    train(settings(1664), tmp_path, make_env=toy)
    errors = capsys.readouterr().err
    assert f"checkpoint {new.name} is damaged" in errors and "the one before" in errors
    run(tmp_path / "whole", int(old.name.split("-")[1]))
    run(tmp_path / "whole", 1664)
    assert_same(last(tmp_path / "whole"), last(tmp_path))


def test_all_checkpoints_damaged_is_an_error_not_a_fresh_start(tmp_path: Path) -> None:
    run(tmp_path, 1280)
    for path in checkpoints.listing(tmp_path / "checkpoints"):
        (path / "state.json").write_text("")
    with pytest.raises(CheckpointError, match="no usable checkpoint"):
        run(tmp_path, 1664)


def test_other_settings_or_versions_are_refused_readably(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(tmp_path, 512)
    with pytest.raises(ConfigError, match=r"num_envs: 8 -> 16\n.*ppo\.gamma: 0\.985 -> 0\.9"):
        run(tmp_path, 1024, num_envs=16, **{"ppo.gamma": 0.9})
    with pytest.raises(ConfigError, match="512 steps"):
        train(settings(1024), tmp_path, resume=False, make_env=toy, quiet=True)
    monkeypatch.setattr("tactile_kit.runs.training.versions", lambda: {"torch": "9.9"})
    with pytest.raises(ConfigError, match=r"version of torch: 2\S* -> 9\.9"):
        run(tmp_path, 1024)


def test_lines_after_the_checkpoint_are_dropped_on_resume(tmp_path: Path) -> None:
    run(tmp_path, 512)
    with (tmp_path / "metrics.jsonl").open("a") as file:
        file.write('{"step": 640, "success": 1.0}\n{"step": 7')
    run(tmp_path, 1024)
    steps = [line["step"] for line in read_metrics(tmp_path)]
    assert steps == sorted(set(steps)) and all(line["success"] != 1.0 for line in read_metrics(tmp_path))


def test_warm_start_is_recorded(tmp_path: Path) -> None:
    run(tmp_path / "first", 512)
    second = settings(512, warm_start=str(tmp_path / "first"))
    train(second, tmp_path / "second", make_env=lambda config: ToyEnv(8, sigma=2), quiet=True)
    manifest = load_agent(tmp_path / "second").manifest
    assert manifest.warm_start["from"] == "first" and manifest.warm_start["steps"] == 512
    assert "from the weights of `first`" in (tmp_path / "second/README.md").read_text()


def test_an_environment_that_fails_is_closed_and_the_lock_released(tmp_path: Path) -> None:
    class Broken(ToyEnv):
        closed = False

        def step_wait(self):
            raise RuntimeError("worker 1 died")

        def close(self):
            Broken.closed = True

    with pytest.raises(RuntimeError, match="worker 1 died"):
        train(settings(512), tmp_path, make_env=lambda config: Broken(8), quiet=True)
    assert Broken.closed
    run(tmp_path, 512)
