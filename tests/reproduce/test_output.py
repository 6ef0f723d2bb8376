"""What commands print of their results: tables for people, JSON for programs, a training's last words."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import object_sets
from reproduce.inventory import TACTILE
from reproduce.output import columns, counted, tell
from reproduce.stages.evaluate import summary_of
from reproduce.summary import summary
from tactile_kit.evaluation import write_rows


@pytest.fixture
def measured(world, tmp_path: Path) -> dict:
    cube, apple = object_sets.select("cube,apple")
    rows = [*world.draw(TACTILE, cube, 24, 24), *world.draw(TACTILE, apple, 6, 24)]
    out = tmp_path / "episodes.csv"
    write_rows(out, rows)
    return summary_of(rows, out)


def test_a_table_for_people_and_a_last_line_for_programs(measured, capsys) -> None:
    tell(measured, programs=False)
    *table, last = capsys.readouterr().out.splitlines()
    assert json.loads(last) == measured and measured["episodes"] == 48
    words = [line.split() for line in table]
    assert words[0][:1] == ["success"] and [line[0] for line in words[1:4]] == ["cube", "apple", "all"]
    assert words[1][1] == "1.00" and words[2][1] == "0.25" and words[3][1] == "0.62"
    assert words[2][5] == "6" and words[3][-1] == "48"  # every third of the 18 failures is a drop


def test_json_alone(measured, capsys) -> None:
    tell(measured, programs=True)
    assert json.loads(capsys.readouterr().out) == measured


def test_a_terminal_needs_no_json(measured, capsys, monkeypatch) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    tell(measured, programs=False)
    assert "{" not in capsys.readouterr().out


def test_a_bar_begins_when_there_is_something_to_count(capsys) -> None:
    with counted("evaluate", "episodes") as show:
        assert capsys.readouterr().err == ""
        show(0, 4)
        show(4, 4)
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("evaluate: 0/4 episodes") and said[-1].startswith("evaluate: 4/4 episodes")


def test_columns() -> None:
    lines = [("a", "bb", "c"), ("aaa", "b", "cc")]
    assert columns(lines) == ["a    bb   c", "aaa   b  cc"]
    assert columns(lines, left=(0, 2)) == ["a    bb  c", "aaa   b  cc"]


@pytest.mark.parametrize(
    "evaluation, words",
    [
        (
            {"success_rate": 0.5, "episodes": 48, "drops": 0.25},
            "0.50 (0.36 to 0.64) of 48 held-out episodes, drops 0.25",
        ),
        (None, "0.75 of the last episodes, exploring; not evaluated held out"),
    ],
)
def test_a_training_ends_with_what_next(tmp_path: Path, evaluation: dict | None, words: str) -> None:
    directory = tmp_path / "mine"
    directory.mkdir()
    manifest = {
        "steps": 2_000_000, "hours": 0.25, "objects": "cube,gear", "evaluation": evaluation,
        "training": {"success": 0.75}, "warm_start": {"from": "older", "steps": 1_000_000},
    }  # fmt: skip
    (directory / "agent.json").write_text(json.dumps(manifest))
    said = summary(directory)
    assert words in said and "2,000,000 steps in 15:00, from older of 1,000,000 steps" in said
    assert f"reproduce view --agent {directory} --objects cube\n" in said
    assert "--objects cube,gear --out mine.gif\n" in said
