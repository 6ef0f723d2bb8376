"""The planner, tiny, on real physics: the agents' own episodes, rows that hold together, any number of workers."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from tactile_kit.evaluation import EvaluationError, read_rows, write_rows
from tactile_kit.evaluation.planner import evaluate_planner
from tactile_kit.evaluation.schedule import STEPS_PER_SECOND, schedule
from tactile_kit.planning import Planner, PlannerConfig
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.core import Core

TINY = PlannerConfig(plans=6, plans_at_goal=6, horizon=5, finalists=2, repeats=1)
SETTINGS = {"objects": "cube", "planner": TINY, "goals_per_case": 3, "seed": 3}


@pytest.fixture(scope="module")
def played():
    return list(evaluate_planner(**SETTINGS))


def test_rows_say_what_was_planned_and_what_it_cost(played, tmp_path):
    rows = [row for row, _ in played]
    for row, seconds in played:
        assert (row.agent, row.kind, row.encoding, row.training_seed) == ("planner", "planner", "truth", 0)
        assert (row.object, row.given, row.object_id, row.size) == ("cube", "cube", 8, 0) and not row.fault
        assert 0 <= row.theta_min <= row.theta <= math.pi
        assert row.success == (row.theta < 0.4 and not row.drop)
        assert 1 <= row.steps <= 100 and (row.drop or row.steps == 100)
        assert 0 < seconds < 100
    assert len({row.goal for row in rows}) == len({row.seed for row in rows}) == 3
    assert [row.goal for row in read_rows(write_rows(tmp_path / "rows.csv", rows))] == [r.goal for r in rows]


def test_workers_and_what_is_left_out_change_no_row(played):
    first = played[0][0]
    spread = [row for row, _ in evaluate_planner(**SETTINGS, num_workers=2, done={first.seed})]
    assert spread == [row for row, _ in played[1:]]


def test_the_episodes_are_the_agents_own():
    """Seeds, goals, bodies, grasps and the whole task, an agent's own inputs apart."""
    ours = schedule(TaskConfig(encoding="none"), "cube,apple", seed=5)
    agents = schedule(TaskConfig(encoding="vec_bps", gravity=3.0, randomization="none"), "cube,apple", seed=5)
    assert (ours.cases, ours.episodes) == (agents.cases, agents.episodes)
    assert ours.task == agents.task.model_copy(update={"encoding": "none"})
    for name in ("joints", "command", "position", "rotation"):
        for variant in range(2):
            mine, others = ours.variants.bank.grasp(variant, 0), agents.variants.bank.grasp(variant, 0)
            assert (getattr(mine, name) == getattr(others, name)).all()


def test_the_planners_own_world_may_have_coarser_steps():
    plan = schedule(TaskConfig(encoding="none"), "cube", goals_per_case=1)
    simulator = Core(plan.task, variants=plan.variants).blueprint.build()
    planners = [Planner(simulator, TINY.model_copy(update={"steps_per_second": n})) for n in (None, 60)]
    try:
        assert [planner.world.config.steps_per_second for planner in planners] == [STEPS_PER_SECOND, 60]
        simulator.reset(0, 0, 9.81)
        ends = []
        for planner in planners:
            planner.start(0)
            planner.play(
                simulator.world.snapshot(), planner._plans(1.0)[0], plan.specs[0].goal, np.zeros(5, bool)
            )
            ends.append((planner.world.position, planner.world.joints))
        # The same half second of holding still: other steps, hardly another place.
        (x, joints), (coarse_x, coarse_joints) = ends
        assert abs(x - coarse_x).max() < 2e-3 and abs(joints - coarse_joints).max() < 0.02
        assert (joints != coarse_joints).any()
        assert simulator.world.config.steps_per_second == STEPS_PER_SECOND
    finally:
        for planner in planners:
            planner.close()
        simulator.close()


@pytest.mark.parametrize(
    "settings",
    [{"num_workers": -1}, {"goals_per_case": 25}, {"episodes_per_goal": 0}, {"steps_per_second": 90}],
)
def test_bad_arguments_are_refused(settings):
    with pytest.raises(EvaluationError, match="allowed"):
        next(evaluate_planner("cube", **settings))


def test_steps_that_miss_the_measurements_are_refused():
    plan = schedule(TaskConfig(encoding="none"), "cube", goals_per_case=1)
    simulator = Core(plan.task, variants=plan.variants).blueprint.build()
    try:
        with pytest.raises(ValueError, match=r"90.*multiples of 60"):
            Planner(simulator, TINY.model_copy(update={"steps_per_second": 90}))
    finally:
        simulator.close()


ORPHANS = """
import os, signal
from multiprocessing import active_children
from tactile_kit.evaluation.planner import evaluate_planner
from tactile_kit.planning import PlannerConfig

if __name__ == "__main__":
    tiny = PlannerConfig(plans=6, plans_at_goal=6, horizon=5, finalists=2, repeats=1)
    rows = evaluate_planner("cube", planner=tiny, goals_per_case=2, num_workers=1)
    next(rows)
    print(*[child.pid for child in active_children()], flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_workers_end_with_a_parent_that_is_killed(tmp_path):
    script = tmp_path / "orphans.py"
    script.write_text(ORPHANS)
    run = subprocess.run(
        [sys.executable, script], stdout=subprocess.PIPE, text=True, timeout=250, check=False
    )
    assert run.returncode == -signal.SIGKILL
    (worker,) = map(int, run.stdout.split()[-1:])
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            return
        with open(f"/proc/{worker}/stat", encoding="utf-8") as file:
            if file.read().rsplit(")", 1)[1].split()[0] == "Z":
                return  # ended; nobody collects it here
        time.sleep(0.2)
    pytest.fail(f"worker {worker} is still running")
