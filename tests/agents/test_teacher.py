"""A teacher acts as its agent would, whatever the student sees, and students come to act like it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactile_kit.agents import load_agent
from tactile_kit.agents.teacher import LAST_RATE, RATE, Lessons, Teacher
from tactile_kit.errors import AgentError
from tactile_kit.runs import RunConfig, train
from tactile_kit.runs.metrics import read_metrics
from tactile_kit.task.vec_env import ReorientVecEnv

SMALL = {"hidden": (32, 32)}
TASK = {"objects": "cube", "horizon": 8, "grasps": 2, "action": "increment"}


def config(encoding: str, **changes) -> RunConfig:
    learner = {
        "rollout": 16, "minibatch": 32, "epochs": 4, "actor": SMALL, "critic": SMALL, "learning_rate": 3e-4,
        "critic_learning_rate": None, "kl_threshold": 0.016, "noise_correlation": 0.0,
    } | changes.pop("ppo", {})  # fmt: skip
    settings = {
        "steps": 64, "num_envs": 4, "encoding": encoding, "log_every": 64, "start_at_grasp": False, "ppo": learner,
        "task": TASK, "evaluation": {"minutes": 0}, "gravity": {"start": 9.81, "steps": 0},
        "episodes": {"engine": "bullet", "drag": 0, "grasps": 2, "grasp_spread": 0.0},
    }  # fmt: skip
    return RunConfig.preset("ppo-smoke", settings | changes)


@pytest.fixture(scope="module")
def oracle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("oracle")
    return train(config("vec_bps", ppo={"log_std": -2.0}), directory, quiet=True)


def student_env(encoding: str = "pos", **task) -> ReorientVecEnv:
    return ReorientVecEnv(config(encoding, task=TASK | task).task, num_envs=3, num_workers=0, seed=5)


def test_a_teacher_acts_as_its_agent_does_where_it_sees_for_itself(oracle: Path) -> None:
    agent, env, own = load_agent(oracle), student_env("pos"), student_env("vec_bps")
    teacher, seen = Teacher(oracle, env), own.reset()
    env.reset()
    for _ in range(4):
        actions = agent.act(seen)
        np.testing.assert_allclose(teacher.actions().numpy(), actions, atol=1e-6)
        env.step(actions)
        seen = own.step(actions)[0]
    assert np.ptp(actions) > 1e-4
    env.close()
    own.close()


def test_a_student_comes_to_act_like_its_teacher(oracle: Path, tmp_path: Path) -> None:
    lessons = {"teacher": str(oracle), "taught_steps": 1920, "log_std": -2.0}
    train(config("pos", steps=1920, ppo=lessons), tmp_path, quiet=True)
    apart = [line["teacher_divergence"] for line in read_metrics(tmp_path)]
    assert apart[-1] < 0.3 * apart[0]


def test_lessons_end_and_returns_take_over(oracle: Path, tmp_path: Path) -> None:
    """While it is taught, sigma stays; a run stopped between two lessons goes on with the next."""
    lessons = {"teacher": str(oracle), "taught_steps": 128}
    train(config("pos", steps=64, ppo=lessons), tmp_path, quiet=True)
    train(config("pos", steps=256, ppo=lessons), tmp_path, quiet=True)
    lines = read_metrics(tmp_path)
    assert [line["step"] for line in lines] == [64, 128, 192, 256]
    assert ["teacher_divergence" in line for line in lines] == [True, True, False, False]
    assert lines[0]["sigma"] == lines[1]["sigma"] != lines[3]["sigma"]


def test_the_teacher_leads_at_first_and_lets_go() -> None:
    lessons = Lessons(None, 100)
    assert [int(lessons.led(step, 8).sum()) for step in (0, 25, 50, 100)] == [8, 4, 0, 0]
    assert lessons.learning_rate(0) == RATE
    assert lessons.learning_rate(100) == pytest.approx(LAST_RATE) == lessons.learning_rate(200)
    assert [lessons.go_on(step) for step in (0, 100, 101)] == [True, True, False]


def test_a_teacher_of_other_actions_is_refused(oracle: Path) -> None:
    env = student_env(action="absolute")
    with pytest.raises(AgentError, match=r"task\.action 'increment', the student's is 'absolute'"):
        Teacher(oracle, env)
    env.close()


def test_a_tactile_agent_cannot_teach(tmp_path: Path) -> None:
    directory = train(config("none", kind="tactile", estimator={"minibatch": 4}), tmp_path, quiet=True)
    env = student_env()
    with pytest.raises(AgentError, match=r"kind 'tactile' can't teach"):
        Teacher(directory, env)
    env.close()
