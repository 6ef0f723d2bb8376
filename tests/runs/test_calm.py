"""Noise falls when success has levelled off, and the run ends after the last time."""

from __future__ import annotations

from pathlib import Path

import pytest
from toy_run import settings, toy

from tactile_kit.agents import load_agent
from tactile_kit.runs import ConfigError, RunConfig, finished, read_metrics, train
from tactile_kit.runs.calm import Calm, CalmConfig

LEVELS = CalmConfig(log_std=(-1.0, -2.0, -2.0), slowing=0.5, patience=100, gain=0.01)


class Watched:
    """A :class:`Calm` shown spans of a hundred steps and a hundred episodes."""

    def __init__(self) -> None:
        self.calm, self.steps, self.successes = Calm(LEVELS), 0, 0
        self.calm.look(True, 0, 0, 0)

    def span(self, percent: int, settled: bool = True) -> int:
        self.steps, self.successes = self.steps + 100, self.successes + percent
        self.calm.look(settled, self.steps, self.steps, self.successes)
        return self.calm.level


def test_a_level_is_kept_while_success_rises() -> None:
    run = Watched()
    assert [run.span(percent) for percent in (10, 20, 30, 31)] == [0, 0, 0, 0]  # by one in a hundred at least
    assert run.span(31) == 1 and (run.calm.log_std, run.calm.slowed) == (-2.0, 0.5)


def test_no_level_is_left_before_anything_succeeds() -> None:
    run = Watched()
    assert [run.span(percent) for percent in (0, 2, 2, 9, 9, 12)] == [0] * 6
    assert run.span(12) == 1


def test_each_level_gets_two_spans_of_its_own_and_then_it_is_over() -> None:
    run = Watched()
    assert [run.span(50) for _ in range(6)] == [0, 1, 1, 2, 2, 2]
    assert run.calm.over and (run.calm.log_std, run.calm.slowed) == (-2.0, 0.25)
    run.span(90)
    assert run.calm.over


def test_what_is_not_settled_does_not_count() -> None:
    run = Watched()
    assert [run.span(50, settled=False) for _ in range(5)] == [0] * 5
    assert [run.span(percent) for percent in (0, 50, 50)] == [0, 0, 1]  # the first only begins a span


def test_steps_within_a_span_decide_nothing() -> None:
    calm = Calm(LEVELS)
    for steps in range(0, 200, 10):
        calm.look(True, steps, steps, steps // 2)
    assert calm.level == 0
    calm.look(True, 200, 200, 100)
    assert calm.level == 1


def test_its_state_goes_through_json() -> None:
    import json

    run = Watched()
    for percent in (50, 50, 40):
        run.span(percent)
    other = Watched()
    other.calm.restore(json.loads(json.dumps(run.calm.state())))
    other.steps, other.successes = run.steps, run.successes
    assert [run.span(40), run.span(40)] == [other.span(40), other.span(40)] == [2, 2]


def test_ceilings_that_rise_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"calm.*\[-2.0, -1.0\].*never rise"):
        RunConfig.build({"calm": {"log_std": [-2.0, -1.0]}})


def level(directory: Path, **changes) -> Path:
    calm = {"log_std": (-1.0, -3.0), "patience": 512, "gain": 1.0}
    return train(settings(100_000, calm=calm, **changes), directory, make_env=toy, quiet=True)


def test_a_run_that_has_levelled_off_ends_and_stays_ended(tmp_path: Path) -> None:
    level(tmp_path)
    manifest = load_agent(tmp_path).manifest
    assert manifest.levelled and manifest.steps < 10_000 and finished(tmp_path)
    lines = read_metrics(tmp_path)
    assert {line["level"] for line in lines if line["gravity"] < 9.81} == {0}
    assert lines[-1]["level"] == 1 and lines[-1]["sigma"] < 0.051
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.safetensors")}
    level(tmp_path)
    assert before == {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.safetensors")}
