"""The batched environment: the same episodes as the single one, from any number of workers."""

from __future__ import annotations

import multiprocessing

import numpy as np
import pytest

import tactile_kit
from tactile_kit.rotations import exp, geodesic, octahedral, to_6d
from tactile_kit.simulation.vector import WorkerError
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.env import ReorientEnv
from tactile_kit.task.goals import EpisodeSpec


def specs(count: int) -> list[EpisodeSpec]:
    return [EpisodeSpec(i % 2, i % 2, octahedral()[i % 24], 100 + i) for i in range(count)]


def test_an_episode_is_the_single_environments(task, build) -> None:
    """Step by step, for cube and L, through the end of the episode."""
    listed = specs(2)
    batch, single = build(episodes=listed), ReorientEnv(task)
    actions = np.random.default_rng(0).uniform(-0.6, 0.2, (5, 2, 12)).astype(np.float32)
    batched = [batch.reset()]
    steps = []
    for action in actions:
        batch.step_async(action)
        steps.append(batch.step_wait())
    for i, spec in enumerate(listed):
        observation, reset_info = single.reset(options={"episode": spec})
        np.testing.assert_array_equal(batched[0][i], observation)
        total = 0.0
        for number, action in enumerate(actions[:, i]):
            observation, reward, terminated, truncated, info = single.step(action)
            seen, rewards, dones, infos = steps[number]
            total += reward
            assert rewards[i] == pytest.approx(reward, abs=1e-6)
            assert dones[i] == (terminated or truncated)
            if dones[i]:
                np.testing.assert_array_equal(infos[i]["terminal_observation"], observation)
                for name in ("theta", "success", "drop", "fault"):
                    assert infos[i][name] == info[name]
                assert infos[i]["episode"] == {"r": pytest.approx(total, abs=1e-5), "l": number + 1}
                assert infos[i]["randomization"].keys() == reset_info["randomization"].keys()
                break
            np.testing.assert_array_equal(seen[i], observation)
        else:
            pytest.fail("the episode did not end")
    single.close()


def test_the_number_of_workers_changes_nothing(build, play) -> None:
    """Three environments, through ends of episodes into new ones."""
    runs = [play(build(num_envs=3, num_workers=workers, seed=4), 8) for workers in (0, 1, 2)]
    for other in runs[1:]:
        np.testing.assert_array_equal(other[0], runs[0][0])
        for step, expected in zip(other[1:], runs[0][1:], strict=True):
            for array, right in zip(step[:3], expected[:3], strict=True):
                np.testing.assert_array_equal(array, right)
            for info, right in zip(step[3], expected[3], strict=True):
                np.testing.assert_equal(info, right)
    assert any(step[2].any() for step in runs[0][1:6])


def test_the_seed_names_the_episodes(build, play) -> None:
    first, same, other = (play(build(seed=seed), 6) for seed in (1, 1, 2))
    for one, two in zip(first[1:], same[1:], strict=True):
        np.testing.assert_array_equal(one[0], two[0])
    assert not np.array_equal(first[0], other[0])


def test_listed_episodes_fill_the_results_in_their_order(task, build) -> None:
    """Five episodes in three environments, one of which drops early; spare environments count for nothing."""
    listed = specs(5)
    env = build(num_envs=3, episodes=listed)
    env.reset()
    assert not env.finished and env.results == [None] * 5
    rounds = 0
    while not env.finished:
        action = np.zeros((3, 12), np.float32)
        action[1] = -1.0  # opens the hand
        env.step_async(action)
        env.step_wait()
        rounds += 1
        assert rounds < 20
    for spec, result in zip(listed, env.results, strict=True):
        assert result.spec is spec
        assert 0 <= result.theta_min <= result.theta <= np.pi + 1e-9
        assert 1 <= result.steps <= task.horizon and np.isfinite(result.reward)
        assert result.success == (not result.drop and result.theta < task.success_angle)
    kept = list(env.results)
    env.step_async(np.zeros((3, 12), np.float32))
    env.step_wait()
    assert env.results == kept


def test_a_reset_begins_the_list_again(build, play) -> None:
    env = build(episodes=specs(2))
    one = play(env, 5)
    assert env.finished
    thetas = [result.theta for result in env.results]
    two = play(env, 3)
    assert not env.finished
    np.testing.assert_array_equal(one[0], two[0])
    play(env, 5)
    assert [result.theta for result in env.results] == thetas


def test_lists_that_can_not_be_played_are_refused(build) -> None:
    with pytest.raises(ValueError, match="episodes is empty"):
        build(episodes=[])
    with pytest.raises(ValueError, match=r"episodes\[1\].given = 2: allowed are 0 to 1"):
        build(episodes=[*specs(1), EpisodeSpec(0, 2, np.eye(3), 0)])


def test_a_wrong_mesh_changes_the_shape_term_and_nothing_else(build) -> None:
    right, wrong = (EpisodeSpec(0, given, octahedral()[5], 3) for given in (0, 1))
    env = build(episodes=[right, wrong])
    observation, reward = env.reset(), np.zeros(2)
    rng = np.random.default_rng(0)
    for _ in range(4):
        for term, part in env.layout.items():
            same = np.array_equal(observation[0, part], observation[1, part])
            assert same == (term != "shape"), term
        assert reward[0] == reward[1]
        np.testing.assert_array_equal(env.state.given, [0, 1])
        env.step_async(np.tile(rng.uniform(-0.6, 0.2, 12).astype(np.float32), (2, 1)))
        observation, reward, _, _ = env.step_wait()


def test_observations_hold_what_the_state_says(build, play) -> None:
    env = build()
    observation = play(env, 3)[-1][0]
    state, layout = env.state, env.layout
    np.testing.assert_array_equal(observation[:, layout["joints"]], state.z)
    np.testing.assert_allclose(observation[:, layout["pose"]][:, :3], state.x, atol=1e-7)
    np.testing.assert_allclose(
        observation[:, layout["goal"]], to_6d(state.goal @ np.swapaxes(state.R, 1, 2)), atol=1e-6
    )
    np.testing.assert_array_equal(state.elapsed, 3)
    assert observation.dtype == np.float32 and env.observation_space.contains(observation[0])


def test_transitions_and_terminal_observations(task, build, play) -> None:
    env = build(seed=9)
    rows = play(env, task.horizon)
    observation, reward, done, infos = rows[-1]
    transition = env.transition
    assert done.all()  # held so far: time ends both
    for i in range(2):
        assert infos[i]["TimeLimit.truncated"]
        assert not np.array_equal(
            observation[i], infos[i]["terminal_observation"]
        )  # the next episode's first
        assert infos[i]["theta"] == pytest.approx(geodesic(transition.R[i], transition.goal[i]))
        assert infos[i]["episode"]["r"] == pytest.approx(sum(row[1][i] for row in rows[1:]), abs=1e-5)
        assert infos[i]["randomization"]["gravity"] == 9.81
    np.testing.assert_allclose(reward, sum(transition.reward_terms.values()), atol=1e-6)
    np.testing.assert_array_equal(env.state.elapsed, 0)
    np.testing.assert_array_equal(env.state.R, env.state.R0)
    assert all(info == {} for row in rows[1:-1] for i, info in enumerate(row[3]) if not row[2][i])


def test_gravity_is_of_the_episodes_to_come(task, build) -> None:
    env = build(TaskConfig(**{**task.model_dump(), "gravity": 0.981}))
    env.reset()
    env.set_gravity(5.0)
    used = []
    for _ in range(2 * task.horizon):
        env.step_async(np.zeros((2, 12), np.float32))
        infos = env.step_wait()[3]
        used += [info["randomization"]["gravity"] for info in infos[:1] if info]
    assert used[0] == 0.981 and set(used[1:]) == {5.0} and len(used) >= 2


def test_a_fault_ends_its_own_environments_episode_only(build) -> None:
    env = build(num_workers=1)
    env.reset()
    action = np.zeros((2, 12), np.float32)
    action[1, 3] = np.nan
    env.step_async(action)
    observation, reward, done, infos = env.step_wait()
    np.testing.assert_array_equal(done, [False, True])
    assert "not finite" in infos[1]["fault"] and not infos[1]["success"] and not infos[1]["drop"]
    assert not infos[1]["TimeLimit.truncated"] and infos[1]["episode"]["l"] == 1
    assert np.isfinite(observation).all() and np.isfinite(reward).all()
    assert np.isfinite(infos[1]["terminal_observation"]).all()
    env.step_async(np.zeros((2, 12), np.float32))
    assert np.isfinite(env.step_wait()[0]).all()


def test_a_dead_worker_ends_the_environment_with_an_error(build) -> None:
    before = {process.pid for process in multiprocessing.active_children()}
    env = build(num_workers=2)
    env.reset()
    worker = next(p for p in multiprocessing.active_children() if p.pid not in before)
    worker.kill()
    worker.join()
    with pytest.raises(WorkerError, match="died with exit code -9"):
        env.step(np.zeros((2, 12), np.float32))
    assert {process.pid for process in multiprocessing.active_children()} <= before


def test_make_vec_is_the_way_in(variants) -> None:
    env = tactile_kit.make_vec(objects="cube,l_shape", grasps=2, horizon=3, num_envs=2, num_workers=0, seed=1)
    assert env.num_envs == 2 and env.reset().shape == (2, 351)
    assert env.env_is_wrapped(object) == [False, False]
    assert env.get_attr("gravity") == [9.81, 9.81]
    with pytest.raises(AttributeError):
        env.set_attr("gravity", 1.0)
    env.close()


def test_the_goal_turns_with_the_episode(build) -> None:
    """theta is measured to the episode's own goal in the hand frame."""
    env = build(episodes=[EpisodeSpec(0, 0, np.eye(3), 5), EpisodeSpec(0, 0, exp(np.array([0, 0, 1.0])), 5)])
    env.reset()
    angle = geodesic(env.state.R, env.state.goal)
    np.testing.assert_allclose(
        angle, [geodesic(env.state.R[0], np.eye(3)), geodesic(env.state.R[0], exp(np.array([0, 0, 1.0])))]
    )
    np.testing.assert_array_equal(env.state.x[0], env.state.x[1])


def test_observations_and_angles_follow_new_episodes(task, build) -> None:
    """Only rows that changed are looked at again; all are what a look at everything shows, to the bit."""
    env = build(task.model_copy(update={"horizon": 5}), num_envs=4, seed=2)
    env.reset()
    ends = 0
    for number in range(12):
        left = geodesic(env.state.R, env.state.goal)
        np.testing.assert_array_equal(env._theta, left)
        assert (env._theta_min <= left).all()
        action = np.zeros((4, 12), np.float32)
        action[0] = -1.0 if number % 5 == 2 else 0.0  # one environment drops before the others end
        observation, _, dones, infos = env.step(action)
        np.testing.assert_array_equal(observation, env._observe())
        ends += int(dones.sum())
        assert [bool(info) for info in infos] == dones.tolist()
        for i in np.flatnonzero(dones):
            assert infos[i]["theta"] == geodesic(env.transition.R[i], env.transition.goal[i])
            assert not np.array_equal(observation[i], infos[i]["terminal_observation"])
    assert ends >= 8
