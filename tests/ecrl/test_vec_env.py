"""The tactile environment in the simulator: observations are built from the belief, rewards from the truth."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch
from estimator_cases import TINY

from tactile_kit.ecrl import ECRLConfig, TactileVecEnv
from tactile_kit.estimator import EstimatorCell, EstimatorConfig, EstimatorError, KalmanFilter, Rest, new_cell
from tactile_kit.rotations import octahedral, to_6d
from tactile_kit.shape import ENCODINGS
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.goals import EpisodeSpec
from tactile_kit.task.variants import Variants, prepare
from tactile_kit.task.vec_env import ReorientVecEnv

TASK = TaskConfig(objects="cube", horizon=6, grasps=2)
E = 3


@pytest.fixture(scope="module")
def variants() -> Variants:
    return prepare(TASK)


@pytest.fixture
def build(variants: Variants) -> Iterator:
    made = []

    def make(
        task: TaskConfig = TASK, rho: float = 0.0, kind: type = TactileVecEnv, **settings
    ) -> ReorientVecEnv:
        if kind is TactileVecEnv:
            defaults = {
                "estimator": TINY,
                "ecrl": ECRLConfig(rollout=4, reuse=1, kept=2, rho_start=rho, rho_step=0.0),
            }
            settings = {**defaults, **settings}
        made.append(
            kind(task, **{"num_envs": E, "num_workers": 0, "seed": 5, "variants": variants, **settings})
        )
        return made[-1]

    yield make
    for env in made:
        env.close()


def actions(steps: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-0.6, 0.2, (steps, E, 12)).astype(np.float32)


def run(env: ReorientVecEnv, steps: int) -> tuple[list, list, list, list]:
    env.reset()
    rows = []
    for action in actions(steps):
        env.step_async(action)
        rows.append(env.step_wait())
    return tuple(map(list, zip(*rows, strict=True)))


def test_layout_is_the_papers(build) -> None:
    env = build(estimator=EstimatorConfig.preset("small"))
    assert env.layout.sizes == {"joints": 144, "goal": 6, "shape": 192, "pose": 9, "sigma": 2}
    assert env.observation_space.shape == (353,)
    assert "sigma" not in build(TASK.model_copy(update={"sigma_in_observation": False})).layout


def test_episodes_begin_at_the_known_orientation_and_the_learned_place(build) -> None:
    env = build()
    with torch.no_grad():
        env.estimator.x0.copy_(torch.tensor([0.1, 0.2, -0.1]))
    observation = env.reset()
    layout, state = env.layout, env.state
    np.testing.assert_allclose(observation[:, layout["pose"]][:, 3:], to_6d(state.R0), atol=1e-6)
    np.testing.assert_allclose(observation[:, layout["pose"]][:, :3], [[0.003, 0.006, -0.003]] * E, atol=1e-6)
    np.testing.assert_allclose(
        observation[:, layout["goal"]], to_6d(state.goal @ state.R0.swapaxes(1, 2)), atol=1e-6
    )


def test_observation_is_the_estimate_and_reward_the_truth(build) -> None:
    env, oracle = build(), build(kind=ReorientVecEnv)
    tactile, true = run(env, 4), run(oracle, 4)
    for ours, theirs in zip(tactile[1], true[1], strict=True):
        np.testing.assert_array_equal(ours, theirs)
    layout, state = env.layout, env.coupling.state
    last, truth = tactile[0][-1], true[0][-1]
    np.testing.assert_array_equal(last[:, layout["joints"]], truth[:, oracle.layout["joints"]])
    np.testing.assert_allclose(last[:, layout["pose"]][:, :3], state.x, atol=1e-7)
    np.testing.assert_allclose(
        last[:, layout["goal"]], to_6d(env.state.goal @ state.R.numpy().swapaxes(1, 2)), atol=1e-5
    )
    np.testing.assert_allclose(last[:, layout["sigma"]], env.estimator.sigmas(state).detach(), rtol=1e-5)
    encoded = env.encoding(state.x, state.R, torch.from_numpy(env.state.given))
    np.testing.assert_allclose(last[:, layout["shape"]], encoded, atol=1e-6)
    assert np.abs(last[:, layout["pose"]] - truth[:, oracle.layout["pose"]]).max() > 1e-3


def test_with_rho_one_the_policy_sees_the_oracles_pose(build) -> None:
    env, oracle = build(rho=1.0), build(kind=ReorientVecEnv)
    tactile, true = run(env, 8), run(oracle, 8)
    for name in ("joints", "goal", "shape", "pose"):
        for ours, theirs in zip(tactile[0], true[0], strict=True):
            np.testing.assert_array_equal(ours[:, env.layout[name]], theirs[:, oracle.layout[name]])


def test_the_terminal_observation_has_one_more_update(build) -> None:
    env = build(training=False)
    env.reset()
    cell, coupling = env.estimator, env.coupling
    for action in actions(TASK.horizon):
        before = coupling.state
        env.step_async(action)
        _, _, dones, infos = env.step_wait()
    assert dones.all()
    z = np.stack([info["terminal_observation"][env.layout["joints"]] for info in infos])
    with torch.no_grad():
        after = cell(before, torch.from_numpy(z), env.encoding, torch.zeros(E, dtype=torch.int64))
    pose = np.stack([info["terminal_observation"][env.layout["pose"]] for info in infos])
    np.testing.assert_allclose(pose[:, :3], after.x, atol=1e-7)
    np.testing.assert_allclose(pose[:, 3:], to_6d(after.R.numpy()), atol=1e-6)
    # and then the next episode's first state
    np.testing.assert_allclose(coupling.state.R, env.state.R0, atol=1e-6)


def test_training_on_the_way(build) -> None:
    env = build()
    env.slow(0.5)
    before = [value.clone() for value in env.estimator.parameters()]
    run(env, 9)
    assert env.coupling.iteration == 2
    metrics = env.metrics()
    assert metrics["estimator/iteration"] == 2.0
    assert metrics["estimator/rate"] == pytest.approx(env.estimator.config.learning_rate / 2)
    assert any(not torch.equal(a, b) for a, b in zip(before, env.estimator.parameters(), strict=True))
    started = torch.cat([part.started for part in env.coupling.memory.recent])
    assert started[0].all()
    assert started[TASK.horizon].all()


def test_listed_episodes_are_played_without_learning(build) -> None:
    episodes = [EpisodeSpec(0, 0, goal, seed) for seed, goal in enumerate(octahedral()[:4])]
    env = build(rho=1.0, episodes=episodes)
    assert not env.training
    env.reset()
    for action in actions(3 * TASK.horizon):
        env.step_async(action)
        env.step_wait()
    assert env.finished
    assert env.coupling.iteration == 0
    assert not env.coupling.truth.any()


def test_results_do_not_depend_on_workers(build) -> None:
    ends = []
    for workers in (0, 2):
        env = build(rho=0.5, num_workers=workers)
        observations, rewards, *_ = run(env, 9)
        ends.append((observations[-1], rewards[-1], env.get_state()))
    np.testing.assert_array_equal(ends[0][0], ends[1][0])
    np.testing.assert_array_equal(ends[0][1], ends[1][1])
    for name, value in ends[0][2].items():
        np.testing.assert_array_equal(value, ends[1][2][name], err_msg=name)


def test_state_moves_to_another_environment(build) -> None:
    env = build()
    run(env, 6)
    saved = env.get_state()
    other = build(seed=6)
    other.set_state(saved)
    assert other.coupling.iteration == env.coupling.iteration == 1
    for name, value in other.get_state().items():
        np.testing.assert_array_equal(value, saved[name], err_msg=name)
    run(other, 3)  # the open roll-out goes on with the new episodes
    assert other.coupling.iteration == 2


@pytest.mark.parametrize("name", ["none", "bps", "pos"])
def test_the_estimators_encoding_may_differ_from_the_policys(build, name: str) -> None:
    env = build(estimator=TINY.model_copy(update={"encoding": name}))
    run(env, 5)
    assert env.estimator.shape.name == name
    assert env.layout.sizes["shape"] == 192
    assert env.coupling.iteration == 1


def test_a_cell_of_another_encoding_is_refused(build) -> None:
    cell: EstimatorCell = new_cell(TINY, ENCODINGS["bps"], 0)
    with pytest.raises(EstimatorError, match=r"'bps'.*'vec_bps'"):
        build(estimator=cell)


def test_kalman_filter_as_belief(build) -> None:
    env = build(estimator=KalmanFilter())
    assert not env.training
    observations, *_ = run(env, 4)
    assert np.isfinite(observations[-1]).all()
    assert env.metrics()["rho"] == 0


def test_anything_with_a_cells_interface_tells_the_policy(build) -> None:
    env = build(estimator=Rest())
    assert not env.training
    env.reset()
    told = []
    for _ in range(2):
        env.step(np.zeros((env.num_envs, 12), np.float32))
        told.append(env.estimated.R.copy())
    first = told[0]
    np.testing.assert_array_equal(env.estimated.R, first)
    assert (env.estimated.sigma == 1.0).all()
