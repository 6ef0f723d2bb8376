"""Evaluation on real physics with an agent that was trained for seconds."""

from __future__ import annotations

import json
import math

import pytest

from object_sets import UnknownObjectError
from randomization import STANDARD_GRAVITY
from tactile_kit.agents.agent import load_agent
from tactile_kit.evaluation import EvaluationError, evaluate, read_rows, success_rate
from tactile_kit.evaluation.schedule import STEPS_PER_SECOND, evaluation_task, schedule
from tactile_kit.runs import RunConfig, train
from tactile_kit.task.config import TaskConfig

pytestmark = pytest.mark.slow

SMALL = {"goals_per_case": 2, "num_envs": 4}


@pytest.fixture(scope="module")
def agent(tmp_path_factory):
    changes = {
        "steps": 400,
        "objects": "cube",
        "randomization": "none",
        "task.gravity": 5.0,
        "task.grasps": 2,
        "episodes.grasps": 2,
    }
    config = RunConfig.preset("ppo-smoke", changes)
    return load_agent(train(config, tmp_path_factory.mktemp("runs") / "oracle-vec_bps-cube-s0", quiet=True))


def test_rows_say_what_was_played(agent):
    rows = evaluate(agent, "cube,apple", episodes_per_goal=2, seed=3, **SMALL)
    assert [(row.object, row.given, row.size) for row in rows] == [("cube", "cube", 0)] * 4 + [
        ("apple", "apple", 0)
    ] * 4
    assert [row.episode for row in rows] == [0, 1] * 4
    assert len({row.seed for row in rows}) == 8
    assert rows[4].extent_x == pytest.approx(0.0754, abs=1e-4) and rows[4].object_id == 12
    for row in rows:
        assert row.agent == "oracle-vec_bps-cube-s0" and row.kind == "oracle" and not row.fault
        assert 0 <= row.theta_min <= row.theta <= math.pi
        assert row.success == (row.theta < 0.4 and not row.drop)
        assert 1 <= row.steps <= 100 and (row.drop or row.steps == 100)


def test_rows_do_not_depend_on_the_number_of_workers(agent):
    settings = {"objects": "cube", "goals_per_case": 6, "seed": 1, "num_envs": 4}
    assert evaluate(agent, **settings, num_workers=0) == evaluate(agent, **settings, num_workers=2)


def test_another_number_of_environments_plays_the_same_episodes(agent):
    settings = {"objects": "cube", "goals_per_case": 3, "seed": 1}
    one, many = evaluate(agent, **settings, num_envs=1), evaluate(agent, **settings, num_envs=8)
    # What follows may differ: batches of another size round differently in the last bit, and contacts amplify that.
    assert [(r.goal, r.seed, r.episode) for r in one] == [(r.goal, r.seed, r.episode) for r in many]


def test_the_same_call_gives_the_same_rows(agent):
    assert evaluate(agent, "cube", seed=5, **SMALL) == evaluate(agent, "cube", seed=5, **SMALL)


def test_a_filter_in_the_estimators_place_plays_the_same_episodes(agent):
    own, told = (
        evaluate(agent, "cube", seed=5, **SMALL),
        evaluate(agent, "cube", seed=5, estimator="kalman", **SMALL),
    )
    assert [(r.goal, r.seed, r.episode) for r in own] == [(r.goal, r.seed, r.episode) for r in told]
    assert [r.theta for r in own] != [r.theta for r in told]  # the oracle is told estimates
    assert not any(r.fault for r in told) and agent.estimator is None


def test_all_agents_are_evaluated_alike(agent):
    task = evaluation_task(agent.task, "paper", 0)
    assert agent.task.gravity == 5.0 and agent.task.randomization == "none"  # what it was trained under
    assert (task.gravity, task.randomization) == (STANDARD_GRAVITY, "default")
    assert (task.horizon, task.goals, task.success_angle) == (100, "octahedral", 0.4)
    assert (task.encoding, task.action) == (agent.task.encoding, agent.task.action)
    assert task.grasp_spread == 0.0
    finer = agent.task.simulation.model_copy(update={"steps_per_second": STEPS_PER_SECOND})
    assert task.simulation == finer and finer != agent.task.simulation
    assert evaluation_task(agent.task, "paper", 0, steps_per_second=240).simulation.steps_per_second == 240
    eased = agent.task.simulation.model_copy(update={"engine": "compiled", "drag": 20.0})
    assert evaluation_task(agent.task.model_copy(update={"simulation": eased}), "paper", 0) == task
    with pytest.raises(EvaluationError, match=r"100.*multiples of 60"):
        evaluation_task(agent.task, "paper", 0, steps_per_second=100)


def test_the_planner_meets_the_same_episodes(agent):
    rows = evaluate(agent, "cube", seed=3, **SMALL)
    plan = schedule(TaskConfig(encoding="none"), "cube", seed=3, goals_per_case=SMALL["goals_per_case"])
    assert [(r.goal, r.episode, r.seed) for r in rows] == [(e.goal, e.repeat, e.seed) for e in plan.episodes]


def test_random_sizes_told_right_and_median(agent):
    settings = {"objects": "cube", "scaling": "random", "sizes": 2, "seed": 0, **SMALL}
    right, median = evaluate(agent, **settings), evaluate(agent, given="nominal", **settings)
    assert [r.seed for r in right] == [r.seed for r in median]
    assert {row.size for row in right} == {1, 2}
    for one, other in zip(right, median, strict=True):
        held = (one.extent_x, one.extent_y, one.extent_z)
        assert held == (other.extent_x, other.extent_y, other.extent_z)
        assert all(0.045 <= extent <= 0.09 for extent in held) and len(set(held)) == 3
        assert (one.given_extent_x, one.given_extent_y, one.given_extent_z) == held
        assert other.given_extent_x == other.given_extent_y == other.given_extent_z == pytest.approx(0.0675)


def test_confusion_and_a_single_wrong_mesh(agent):
    rows = evaluate(agent, "cube,apple", given="each", goals_per_case=1, num_envs=4)
    assert sorted((row.given, row.object) for row in rows) == [
        (a, b) for a in ("apple", "cube") for b in ("apple", "cube")
    ]
    rows = evaluate(agent, "cube", given="cylinder", goals_per_case=1, num_envs=4)
    assert [(row.given, row.object) for row in rows] == [("cylinder", "cube")]


def test_progress_counts_up_to_all(agent):
    calls = []
    rows = evaluate(agent, "cube", progress=lambda done, total: calls.append((done, total)), **SMALL)
    assert calls[-1] == (len(rows), len(rows)) and sorted(calls) == calls


@pytest.mark.parametrize(
    "settings",
    [
        {"sizes": 2},
        {"estimator": "kalmann"},
        {"num_envs": 0},
        {"episodes_per_goal": 0},
        {"goals_per_case": 30},
        {"goals": "cubic"},
        {"world": "compiled"},
        {"world": "mujocco"},
    ],
)
def test_bad_arguments_are_refused(agent, settings):
    with pytest.raises(EvaluationError, match="allowed"):
        evaluate(agent, "cube", **settings)


def test_another_world_plays_the_same_protocol(agent):
    """An episode an object of the paper's, in MuJoCo: same goals and seeds, own grasps, own ends."""
    pytest.importorskip("mujoco")
    settings = {"objects": "cube,l_shape,apple", "goals_per_case": 1, "seed": 3, "num_envs": 3}
    there = evaluate(agent, world="mujoco", quiet=True, **settings)
    here = evaluate(agent, **settings)
    assert [(r.object, r.goal, r.seed) for r in there] == [(r.object, r.goal, r.seed) for r in here]
    assert {r.world for r in there} == {"mujoco"} and {r.world for r in here} == {"bullet"}
    for row in there:
        assert not row.fault and (row.drop or row.steps == 100) and 0 <= row.theta_min <= row.theta
    assert {r.theta for r in there}.isdisjoint({r.theta for r in here})


def test_a_world_that_is_not_installed_is_said(agent, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(EvaluationError, match=r"world = 'mujoco'.*tactile-kit\[transfer\]"):
        evaluate(agent, "cube", world="mujoco")


def test_unknown_objects_are_named_with_the_nearest(agent):
    with pytest.raises(UnknownObjectError, match="cube"):
        evaluate(agent, "cubee")


def test_the_command_writes_rows_and_ends_with_one_json_object(agent, tmp_path, capsys):
    from reproduce.cli import main

    out = tmp_path / "rows.csv"
    arguments = ["--objects", "cube", "--episodes-per-goal", "1", "--seed", "2", "--out", str(out)]
    assert main(["evaluate", "--agent", str(agent.directory), *arguments]) == 0
    last = json.loads(capsys.readouterr().out.strip().splitlines()[-1])
    rows = read_rows(out)
    assert len(rows) == last["episodes"] == 24 and last["success_rate"] == success_rate(rows).value
    assert sorted(row.goal for row in rows) == list(range(24))
