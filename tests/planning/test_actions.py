"""Gaits as actions: zeros hold and turn, a lifted finger comes back by itself, two fingers always hold."""

from __future__ import annotations

from collections.abc import Iterator

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tactile_kit
from tactile_kit.planning.actions import FINGER, LIFT, GaitActions
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.env import ReorientEnv
from tactile_kit.task.rotations import geodesic, random_rotations
from tactile_kit.task.vec_env import ReorientVecEnv

E = 6


@pytest.fixture(scope="module")
def task() -> TaskConfig:
    return TaskConfig(objects="cube", randomization="none", action="gait", grasps=6)


@pytest.fixture
def env(task: TaskConfig, own_cache: None) -> Iterator[ReorientVecEnv]:
    env = ReorientVecEnv(task, num_envs=E, num_workers=0, seed=3)
    env.reset()
    yield env
    env.close()


def lifting(finger: int) -> np.ndarray:
    """The action of all environments that lifts ``finger``."""
    actions = np.zeros((E, 12))
    actions[:, FINGER + finger] = 1.0
    return actions


def test_zeros_hold_and_turn_towards_the_goal(env) -> None:
    before = geodesic(env.state.R, env.state.goal)
    for _ in range(15):
        _, _, dones, _ = env.step(np.zeros((E, 12)))
        assert (env.actions.stage == -1).all()
        assert not dones.any()
    gained = before - geodesic(env.state.R, env.state.goal)
    assert gained.mean() > 0.15 and np.median(gained) > 0.1


@pytest.mark.parametrize("finger", range(4))
def test_a_lifted_finger_goes_away_and_holds_again(env, finger: int) -> None:
    def distance() -> np.ndarray:
        q = env.simulation.views["q"]
        tips = np.stack([tactile_kit.hand.inverse.tips(row) for row in q])
        return np.linalg.norm(tips[:, finger] - env.state.x, axis=1)

    env.step(np.zeros((E, 12)))
    before = distance()
    env.step(lifting(finger))
    assert (env.actions.stage[:, finger] == 1).all() and (np.delete(env.actions.stage, finger, 1) == -1).all()
    farthest = before
    for _ in range(11):
        _, _, dones, _ = env.step(np.zeros((E, 12)))
        farthest = np.where(dones, farthest, np.maximum(farthest, distance()))
    assert np.median(farthest - before) > 0.004
    assert (env.actions.stage[:, finger] == -1).mean() > 0.5  # the others of them are closing still


def test_two_fingers_always_hold(env) -> None:
    actions = np.zeros((E, 12))
    actions[:, FINGER : FINGER + 4] = [0.9, 0.7, 1.0, 0.8]
    env.step(actions)
    np.testing.assert_array_equal(env.actions.stage >= 0, np.tile([True, False, True, False], (E, 1)))


def test_below_the_threshold_nothing_is_lifted(env) -> None:
    env.step(LIFT * lifting(1))
    assert (env.actions.stage == -1).all()


def test_a_new_episode_begins_with_all_fingers_holding(env) -> None:
    env.step(lifting(0))
    env.reset()
    assert (env.actions.stage == -1).all()


def test_an_action_that_is_not_finite_ends_the_episode_as_a_fault(env) -> None:
    actions = np.zeros((E, 12))
    actions[2, 5] = np.nan
    _, rewards, dones, infos = env.step(actions)
    np.testing.assert_array_equal(dones, np.arange(E) == 2)
    assert "not finite" in infos[2]["fault"] and np.isfinite(rewards).all()


def test_the_single_environment_does_the_same(task, own_cache) -> None:
    many = ReorientVecEnv(task, num_envs=1, num_workers=0, seed=5)
    one = gymnasium.make("tactile_kit/Reorient-v0", config=task, disable_env_checker=True).unwrapped
    assert isinstance(one, ReorientEnv)
    try:
        many.reset()
        observation, _ = one.reset(options={"episode": many._spec[0]})
        generator = np.random.default_rng(0)
        for _ in range(10):
            action = generator.normal(0.0, 0.4, 12)
            first, _, dones, _ = many.step(action[None])
            observation, *_ = one.step(action)
            if dones[0]:
                break
            np.testing.assert_array_equal(first[0], observation)
    finally:
        many.close()
        one.close()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_any_action_becomes_joint_angles_within_range(seed: int) -> None:
    generator = np.random.default_rng(seed)
    gaits = GaitActions(3, 0.27)
    for _ in range(12):
        z = generator.normal(0.0, 0.5, (3, 144)).astype(np.float32)
        R, goal = random_rotations(generator, 3), random_rotations(generator, 3)
        out = gaits(generator.normal(0, 1, (3, 12)), z, generator.normal(0, 0.02, (3, 3)), R, goal)
        assert out.shape == (3, 12) and np.isfinite(out).all() and np.abs(out).max() <= 1.0
        assert ((gaits.stage < 0).sum(axis=1) >= 2).all() and (gaits.stage < 14).all()
