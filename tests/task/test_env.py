"""``tactile_kit/Reorient-v0`` as users and libraries meet it."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check
from stable_baselines3.common.env_checker import check_env as sb3_check

import tactile_kit
from tactile_kit.rotations import exp, to_6d
from tactile_kit.simulation.episode import FULL_RANGE, MIDDLE
from tactile_kit.task.actions import ActionError
from tactile_kit.task.env import ReorientEnv
from tactile_kit.task.goals import EpisodeSpec

SETTINGS: dict[str, Any] = {"objects": "cube,l_shape", "horizon": 5, "grasps": 2}


@pytest.fixture(scope="module")
def env(variants):
    tactile_kit.register()
    env = gymnasium.make(tactile_kit.ENVIRONMENT, **SETTINGS)
    yield env
    env.close()


def hold(env: Any) -> np.ndarray:
    return ((env.unwrapped.simulator.world.command - MIDDLE) / FULL_RANGE).astype(np.float32)


def episode(env: Any, seed: int | None) -> list[np.ndarray]:
    rows = [env.reset(seed=seed)[0]]
    rng = np.random.default_rng(0)
    ended = False
    while not ended:
        observation, _, terminated, truncated, _ = env.step(rng.uniform(-0.6, 0.2, 12).astype(np.float32))
        rows.append(observation)
        ended = terminated or truncated
    return rows


def test_registering_twice_is_fine() -> None:
    tactile_kit.register()
    tactile_kit.register()
    assert tactile_kit.ENVIRONMENT in gymnasium.registry


def test_gymnasium_finds_no_fault(env) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*observation space m.*imum value is -?infinity.*")
        warnings.filterwarnings("ignore", message=".*Not able to test alternative render modes.*")
        gymnasium_check(env.unwrapped, skip_render_check=False)


def test_stable_baselines_finds_no_fault(env) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb3_check(env.unwrapped, warn=True)


def test_observations_are_the_spaces_and_hold_the_pose(env) -> None:
    observation, info = env.reset(seed=3)
    inner = env.unwrapped
    assert observation.shape == (351,) and observation in env.observation_space
    np.testing.assert_allclose(
        observation[inner.layout["pose"]][:3], inner.simulator.world.position, atol=1e-6
    )
    np.testing.assert_allclose(
        observation[inner.layout["pose"]][3:], to_6d(inner.simulator.world.rotation), atol=1e-6
    )
    assert info["episode_spec"].given == info["episode_spec"].variant
    assert info["randomization"]["gravity"] == 9.81


def test_a_seed_repeats_its_episodes(env) -> None:
    first, then = episode(env, 7), episode(env, None)
    for again, before in ((episode(env, 7), first), (episode(env, None), then)):
        np.testing.assert_array_equal(again, before)
    assert not np.array_equal(first[0], then[0])
    assert not np.array_equal(first[0], episode(env, 8)[0])


def test_every_object_has_its_turn(env) -> None:
    played = [env.reset(seed=0)[1]["episode_spec"].variant]
    played += [env.reset()[1]["episode_spec"].variant for _ in range(3)]
    assert played == [0, 1, 0, 1]


def test_one_spec_is_played_on_demand(env) -> None:
    spec = EpisodeSpec(1, 0, exp(np.array([0, 0, 1.0])), 11)
    rows = [env.reset(options={"episode": spec}) for _ in range(2)]
    np.testing.assert_array_equal(rows[0][0], rows[1][0])
    assert rows[0][1]["episode_spec"] is spec
    assert env.unwrapped.simulator.world.body.name == "l_shape"
    with pytest.raises(TypeError, match="EpisodeSpec"):
        env.reset(options={"episode": 3})


def test_success_is_a_small_angle_at_the_end_and_only_there(env) -> None:
    for turn, success in ((0.0, True), (2.0, False)):
        env.reset(options={"episode": EpisodeSpec(0, 0, np.eye(3), 5)})
        goal = exp(np.array([0, turn, 0])) @ env.unwrapped.simulator.world.rotation
        env.reset(options={"episode": EpisodeSpec(0, 0, goal, 5)})
        infos, action = [], hold(env)
        for step in range(5):
            _, reward, terminated, truncated, info = env.step(action)
            assert not terminated and truncated == (step == 4)
            assert reward == pytest.approx(sum(info["reward_terms"].values()))
            infos.append(info)
        assert [info["success"] for info in infos] == [False] * 4 + [success]
        assert infos[-1]["theta"] == pytest.approx(turn, abs=0.3)


def test_a_drop_terminates(variants) -> None:
    env = gymnasium.make(tactile_kit.ENVIRONMENT, **{**SETTINGS, "horizon": 50})
    env.reset(seed=0)
    terminated = truncated = False
    while not (terminated or truncated):
        _, _, terminated, truncated, info = env.step(-np.ones(12, np.float32))
    assert terminated and not truncated and info["drop"] and not info["success"] and info["fault"] is None
    env.close()


def test_an_action_that_is_no_number_is_an_error(env) -> None:
    env.reset(seed=0)
    with pytest.raises(ActionError, match="finite"):
        env.unwrapped.step(np.full(12, np.nan))
    assert env.step(hold(env))[4]["fault"] is None


def test_pictures_show_hand_and_object(variants) -> None:
    env = gymnasium.make(tactile_kit.ENVIRONMENT, render_mode="rgb_array", **SETTINGS)
    env.reset(seed=0)
    image: Any = env.render()
    assert image.shape == (480, 480, 3) and image.dtype == np.uint8
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 20
    env.close()
    with pytest.warns(UserWarning), pytest.raises(ValueError, match="render_mode"):
        gymnasium.make(tactile_kit.ENVIRONMENT, render_mode="ansi", disable_env_checker=True, **SETTINGS)


def test_a_single_environment_is_bullets() -> None:
    with pytest.raises(ValueError, match=r"engine = 'compiled'.*make_vec"):
        ReorientEnv(**SETTINGS, simulation={"engine": "compiled"})
