"""Increments: zero rests, one moves the command on, and the single environment does the same."""

from __future__ import annotations

import gymnasium
import numpy as np

from tactile_kit.hand.kinematics import JOINT_LOWER, JOINT_UPPER, MEAN_GRASP
from tactile_kit.simulation.episode import FULL_RANGE, MIDDLE
from tactile_kit.task.actions import for_simulator, incremented, measured
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.vec_env import ReorientVecEnv


def measurements(q: np.ndarray, e: np.ndarray) -> np.ndarray:
    """``z (E, 144)`` whose last sample is ``q`` and ``e (E, 12)``."""
    z = np.zeros((len(q), 6, 2, 12), np.float32)
    z[:, -1, 0], z[:, -1, 1] = q, e
    return z.reshape(len(q), -1)


def asked(actions: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Target joint angles ``(E, 12)`` rad."""
    return MIDDLE + FULL_RANGE * incremented(actions, z)


def test_the_command_is_what_is_measured_and_what_it_lags_behind_by() -> None:
    q, e = np.full((1, 12), 0.2), np.full((1, 12), 0.05)
    angles, command = measured(measurements(q, e))
    np.testing.assert_allclose(angles, q, atol=1e-7)
    np.testing.assert_allclose(command, q + e, atol=1e-7)


def test_zero_asks_for_the_command_and_one_for_half_a_radian_more() -> None:
    z = measurements(MEAN_GRASP[None], np.full((1, 12), 0.03))
    np.testing.assert_allclose(asked(np.zeros((1, 12)), z)[0], MEAN_GRASP + 0.03, atol=1e-6)
    wanted = np.minimum(MEAN_GRASP + 0.53, JOINT_UPPER)
    np.testing.assert_allclose(asked(np.full((1, 12), 7.0), z)[0], wanted, atol=1e-6)
    wanted = np.maximum(MEAN_GRASP - 0.47, JOINT_LOWER)
    np.testing.assert_allclose(asked(-np.ones((1, 12)), z)[0], wanted, atol=1e-6)


def test_an_action_that_is_not_finite_stays_so() -> None:
    actions = np.zeros((1, 12))
    actions[0, 3] = np.nan
    assert np.isnan(asked(actions, measurements(MEAN_GRASP[None], np.zeros((1, 12))))[0, 3])


def test_the_simulator_s_own_actions_need_nothing() -> None:
    actions = np.full((3, 12), 0.3)
    assert for_simulator(TaskConfig(action="absolute"), actions, np.ones((3, 144), np.float32)) is actions


def test_a_resting_hand_holds_in_both_environments(own_cache: None) -> None:
    task = TaskConfig(objects="cube", randomization="none", action="increment", grasps=2)
    many = ReorientVecEnv(task, num_envs=2, num_workers=0, seed=5)
    one = gymnasium.make("tactile_kit/Reorient-v0", config=task, disable_env_checker=True).unwrapped
    try:
        many.reset()
        one.reset(options={"episode": many.episodes.present[0]})
        for _ in range(100):
            first, _, dones, infos = many.step(np.zeros((2, 12)))
            assert not any(info.get("drop") for info in infos)
            if dones[0]:
                break
            observation, *_ = one.step(np.zeros(12))
            np.testing.assert_array_equal(first[0], observation)
    finally:
        many.close()
        one.close()
