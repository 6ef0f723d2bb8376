"""The commands behind files of courses, on shipped agents in Bullet: what they write, go on with, film and refuse."""

from __future__ import annotations

import dataclasses
import json
import re

import pytest

from reproduce.courses import FOLLOWING, TELLING, TRUTH, condition, courses_to, side_by_side_to
from reproduce.errors import ReproduceError
from reproduce.failing import films_to
from reproduce.files import ROOT, read_csv
from reproduce.inventory import failure_films
from tactile_kit.agents.agent import load_agent
from tactile_kit.errors import EvaluationError
from tactile_kit.evaluation.courses import read_courses, write_courses
from tactile_kit.evaluation.failures import kind_of_moment

AGENTS = ROOT / "results" / "agents"
ORACLE, TACTILE = AGENTS / "oracle-vec_bps-geometric8-s0", AGENTS / "tactile-vec_bps-geometric8-s0"
UNTRAINED = AGENTS / "tactile-none-geometric8-s0"  # drops whatever it holds
FEW = {"objects": "cube", "goals_per_case": 1, "num_workers": 0}


@pytest.mark.slow
def test_estimators_are_set_side_by_side_and_a_stopped_command_goes_on(tmp_path):
    out = tmp_path / "estimators.csv"
    assert side_by_side_to(ORACLE, [TACTILE], out, **FEW) == 7
    names = [TACTILE.name, "kalman", "rest"]
    labels = [TRUTH, *(condition(n, mode) for mode in (FOLLOWING, TELLING) for n in names)]
    lines = read_courses(out)
    assert list(dict.fromkeys(line.condition for line in lines)) == labels
    beside = out.with_suffix(".json")
    costs = json.loads(beside.read_text())["costs"]
    assert list(costs) == names and costs[names[0]]["alone"]["environments"] == 1
    assert costs["rest"]["alone"]["median"] < min(costs[n]["alone"]["median"] for n in names[:2])
    kept = [line for line in lines if line.condition != labels[-1]]
    write_courses(out, kept)
    side_by_side_to(ORACLE, [TACTILE], out, **FEW)
    assert read_courses(out) == lines
    write_courses(out, [dataclasses.replace(line, seed=1) for line in kept])
    with pytest.raises(ReproduceError, match="other episodes"):
        side_by_side_to(ORACLE, [TACTILE], out, **FEW)
    beside.write_text(
        beside.read_text().replace(load_agent(TACTILE).manifest.weights["policy.safetensors"], "0")
    )
    with pytest.raises(ReproduceError, match="made with other agents"):
        side_by_side_to(ORACLE, [TACTILE], out, **FEW)


def test_what_is_no_agent_or_no_estimator_is_refused(tmp_path):
    with pytest.raises(ReproduceError, match="no agent"):
        courses_to(tmp_path, tmp_path / "courses.csv")
    with pytest.raises(EvaluationError, match="an oracle has no estimator"):
        side_by_side_to(ORACLE, [ORACLE], tmp_path / "estimators.csv", **FEW)


@pytest.mark.slow
def test_a_failure_is_filmed_by_its_kind_and_shown_in_the_report(world, tmp_path):
    courses, folder = tmp_path / "courses.csv", tmp_path / "report" / "failures"
    assert courses_to(UNTRAINED, courses, **FEW) == 1
    last = read_courses(courses)[-1]
    assert kind_of_moment(last) == "drop"
    folder.mkdir(parents=True)
    (folder / "stall.mp4").write_bytes(b"of before")
    (row,) = films_to(UNTRAINED, courses, folder, size=64, quiet=True)
    assert (row["kind"], row["object"], row["verdict"]) == ("drop", "cube", "dropped")
    assert read_csv(folder / "failures.csv") == [{key: str(value) for key, value in row.items()}]
    files = failure_films(tmp_path)
    assert [file.name for file in files] == ["failures.csv", "drop.mp4"]
    world.films = list(map(str, files))
    page = world.page(tmp_path)
    assert len(re.findall(r'<video[^>]* src="data:video/mp4;base64,', page)) == 1
    assert f"dropped: cube, goal {last.goal}; dropped" in page
    write_courses(courses, [dataclasses.replace(last, seed=1)])
    with pytest.raises(ReproduceError, match="is no episode of the evaluation of seed 0"):
        films_to(UNTRAINED, courses, folder, size=64, quiet=True)
