"""Demonstrations: complete files, kept files, and the same transitions in a learner's replay memory."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from stable_baselines3.common.callbacks import CallbackList

from tactile_kit.agents.config import PPOConfig, SACConfig
from tactile_kit.agents.ppo import PPO
from tactile_kit.agents.sac import SAC
from tactile_kit.hand.kinematics import FIRM_GRASP
from tactile_kit.planning import Planner
from tactile_kit.planning.demonstrations import DemonstrationError, collect, load, play
from tactile_kit.planning.teaching import examples_of, replay_of
from tactile_kit.simulation.simulator import FULL_RANGE, MIDDLE
from tactile_kit.task.goals import training_episodes
from tactile_kit.task.observation import Belief
from tactile_kit.task.rotations import geodesic
from tactile_kit.task.vec_env import ReorientVecEnv


@pytest.fixture
def env(task, core):
    made = ReorientVecEnv(task, num_envs=2, num_workers=0, variants=core.variants)
    yield made
    made.close()


@pytest.fixture
def learner(env) -> SAC:
    config = SACConfig(warmup=4, batch=32, clone=1.0, demonstration_share=0.5, bfloat16=False)
    return SAC(env, config, seed=0)


def test_a_file_holds_the_episode_and_how_its_plans_went(demonstrations) -> None:
    for path in sorted(demonstrations.iterdir()):
        shown = load(path)
        assert 1 <= len(shown.theta) <= 8 and str(shown.object) == "cube"
        executed = len(shown.length) - 1  # the last piece
        assert shown.length[executed] == len(shown.theta)
        assert len(shown.length) > 2  # two shaken roll-outs of every plan chosen
        assert geodesic(shown.R[-1], shown.goal) == pytest.approx(shown.theta[-1], abs=1e-6)


def test_an_agent_acts_in_between(core, small) -> None:
    """It holds; the planner's actions alone are kept."""
    guide = Planner(core.blueprint.build(), small)
    seen: list[np.ndarray] = []

    def agent(observations: np.ndarray) -> np.ndarray:
        seen.append(observations)
        return np.tile((FIRM_GRASP - MIDDLE) / FULL_RANGE, (1, 1))

    spec = next(training_episodes(core.config, core.variants, 0, 4))
    guide.simulator.horizon = 30
    shown = play(core, guide, spec, 9.81, agent, share=1.0)
    executed = int(shown.length[shown.length != small.horizon - 1].sum())
    assert len(seen) >= 3 and 0 < executed <= len(shown.theta) - len(seen)
    assert seen[0].shape == (1, core.layout.size)
    guide.close()
    guide.simulator.close()


def test_collecting_again_keeps_what_is_there_and_repeats_what_is_not(
    task, small, demonstrations, tmp_path
) -> None:
    first = sorted(demonstrations.iterdir())[0]
    before = first.stat().st_mtime_ns
    collect(task, demonstrations, range(2), seed=5, planner=small)
    assert first.stat().st_mtime_ns == before
    collect(task, tmp_path, range(1), seed=5, planner=small)
    for name, value in vars(load(tmp_path / first.name)).items():
        np.testing.assert_array_equal(value, getattr(load(first), name))


def test_the_replay_shows_what_the_environment_would_have(env, learner, demonstrations) -> None:
    replay = replay_of(env, demonstrations, **learner.replay_settings)
    shown = [load(path) for path in sorted(demonstrations.iterdir())]
    assert len(replay) == sum(int(one.length.sum()) for one in shown)
    first = shown[0]
    executed = int(first.length[0])
    belief = Belief(first.x[:executed].astype(np.float32), first.R[:executed].astype(np.float32))
    goals = np.broadcast_to(first.goal, (executed, 3, 3))
    seen = env.core.observer(first.z[:executed], goals, belief, np.zeros(executed, int))
    np.testing.assert_array_equal(replay.observations[:executed, 0], seen)
    np.testing.assert_array_equal(replay.next_observations[: executed - 1, 0], seen[1:])
    turned = geodesic(first.R[:executed], first.goal) - geodesic(first.R[1 : executed + 1], first.goal)
    np.testing.assert_allclose(replay.rotation_rewards[:executed, 0], np.minimum(turned, 0.1), atol=1e-6)
    ends = np.cumsum(np.concatenate([one.length for one in shown])) - 1
    np.testing.assert_array_equal(np.flatnonzero(replay.done[:, 0]), ends)
    np.testing.assert_array_equal(replay.terminated[ends, 0], np.concatenate([one.failed for one in shown]))


def test_examples_are_what_was_seen_and_done_where_nothing_failed(env, demonstrations) -> None:
    observations, actions = examples_of(env, demonstrations)
    shown = [load(path) for path in sorted(demonstrations.iterdir())]
    assert len(observations) == len(actions) == sum(int(one.length[~one.failed].sum()) for one in shown)
    first = shown[0]
    assert not first.failed[0]
    np.testing.assert_array_equal(actions[: first.length[0]], first.actions[: first.length[0]])
    belief = Belief(first.x[:1].astype(np.float32), first.R[:1].astype(np.float32))
    seen = env.core.observer(first.z[:1], first.goal[None], belief, np.zeros(1, int))
    np.testing.assert_array_equal(observations[:1], seen)


def test_ppo_begins_by_imitating_and_goes_on_beside_learning(env, demonstrations) -> None:
    config = PPOConfig.preset("small").model_copy(
        update={
            "rollout": 8,
            "minibatch": 8,
            "epochs": 2,
            "clone_epochs": 150,
            "clone": 1.0,
            "critic_steps": 16,
        }
    )
    learner, lines = PPO(env, config, seed=0), []
    learner.learn_from(*examples_of(env, demonstrations), report=lines.append)
    distances = [float(line.split(": ")[1].split()[0]) for line in lines]
    assert len(distances) == 150 and distances[-1] < 0.5 * distances[0]
    callback = CallbackList([])
    learner._setup_learn(10**6, callback)
    before = {name: tensor.clone() for name, tensor in learner.policy.actor.named_parameters()}
    learner.iterate(callback)  # the critic alone
    for name, tensor in learner.policy.actor.named_parameters():
        torch.testing.assert_close(tensor, before[name], rtol=0, atol=1e-5)
    assert "clone_distance" not in learner.metrics()
    learner.iterate(callback)
    assert learner.metrics()["clone_distance"] < 0.5 * distances[0]
    other = PPO(env, config, seed=0)
    other.restore(*learner.state())
    other.learn_from(learner.examples.observations.numpy(), learner.examples.actions.numpy())
    for mine, its in zip(learner.examples.batch(4), other.examples.batch(4), strict=True):
        torch.testing.assert_close(mine, its)


def test_hindsight_goals_stay_within_a_piece(env, learner, demonstrations) -> None:
    settings = {**learner.replay_settings, "future_goals": 1.0, "random_goals": 0.0}
    replay = replay_of(env, demonstrations, **settings)
    row = np.repeat(np.arange(len(replay)), 20)
    later = replay._later(row, np.zeros(len(row), int))
    ends = np.flatnonzero(replay.done[:, 0])
    for at, goal in zip(row[::7], later[::7], strict=True):
        end = ends[np.searchsorted(ends, at)]
        assert (np.abs(replay.rotations[at : end + 1, 0, 1] - goal).max((1, 2)) < 1e-6).any()


def test_learning_from_them_imitates_what_the_critics_prefer(env, learner, demonstrations) -> None:
    learner.learn_from(replay_of(env, demonstrations, **learner.replay_settings))
    callback = CallbackList([])
    learner._setup_learn(10**6, callback)
    for _ in range(12):
        learner.iterate(callback)
    found = learner.metrics()
    assert 0 < found["cloned"] <= 1 and found["updates"] > 5


def test_strange_files_are_refused(task, demonstrations, env, learner, tmp_path) -> None:
    with pytest.raises(DemonstrationError, match="no demonstrations"):
        replay_of(env, tmp_path, **learner.replay_settings)
    arrays = vars(load(sorted(demonstrations.iterdir())[0]))
    np.savez(tmp_path / "a.npz", **{name: value for name, value in arrays.items() if name != "goal"})
    with pytest.raises(DemonstrationError, match=r"a\.npz.*goal"):
        load(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", **{**arrays, "x": arrays["x"][:-1]})
    with pytest.raises(DemonstrationError, match=r"a\.npz: x is"):
        load(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", **{**arrays, "object": np.array("teapot")})
    with pytest.raises(DemonstrationError, match="teapot"):
        replay_of(env, tmp_path, **learner.replay_settings)
