"""What every observation and action holds to, over all objects, all encodings and whatever a policy may send."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from episodes import TASK
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import object_sets
from tactile_kit.hand import kinematics
from tactile_kit.rotations import octahedral, random_rotations, to_6d
from tactile_kit.shape import ENCODINGS, MeshTable, encoding
from tactile_kit.task.actions import ActionError
from tactile_kit.task.config import RewardConfig
from tactile_kit.task.env import ReorientEnv
from tactile_kit.task.goals import EpisodeSpec
from tactile_kit.task.observation import Belief, Observer, layout_of
from tactile_kit.task.reward import reward_terms

OBJECTS = tuple(object_sets.load("all"))
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def meshes() -> MeshTable:
    return MeshTable.from_meshes([(thing.vertices, thing.faces) for thing in OBJECTS])


@pytest.mark.parametrize("name", sorted(ENCODINGS))
def test_observations(meshes: MeshTable, name: str) -> None:
    """Of every object near the hand: named terms in their places, finite, each row from its own state alone."""
    shape = encoding(name, meshes)

    @settings(max_examples=15)
    @given(seeds, st.booleans(), st.booleans(), st.floats(0, 0.3))
    def holds(seed: int, pose: bool, sigma: bool, reach: float) -> None:
        rng, count = np.random.default_rng(seed), len(OBJECTS)
        layout = layout_of(shape, pose=pose, sigma=sigma)
        observer = Observer(layout, shape)
        z = rng.normal(0, 1, (count, 144)).astype(np.float32)
        goal, R = random_rotations(rng, count), random_rotations(rng, count).astype(np.float32)
        x = rng.uniform(-reach, reach, (count, 3)).astype(np.float32)
        belief = Belief(x, R, rng.uniform(0, 1, (count, 2)).astype(np.float32))
        rows = observer(z, goal, belief, np.arange(count))
        sizes = {"joints": 144, "goal": 6, "shape": shape.observation_size, "pose": 9, "sigma": 2}
        given_terms = {
            "joints",
            "goal",
            *(["shape"] if shape.observation_size else []),
            *(["sigma"] if sigma else []),
        }
        given_terms |= {"pose"} if pose and shape.pose_beside else set()
        assert list(layout) == [term for term in sizes if term in given_terms]
        assert {term: part.stop - part.start for term, part in layout.items()} == {
            t: sizes[t] for t in layout
        }
        assert rows.shape == (count, layout.size) and rows.dtype == np.float32 and np.isfinite(rows).all()
        np.testing.assert_array_equal(rows[:, layout["joints"]], z)
        np.testing.assert_allclose(rows[:, layout["goal"]], to_6d(goal @ np.swapaxes(R, 1, 2)), atol=1e-6)
        if "pose" in layout:
            np.testing.assert_array_equal(rows[:, layout["pose"]], np.concatenate([x, to_6d(R)], axis=1))
        order = rng.permutation(count)
        shuffled = observer(z[order], goal[order], Belief(x[order], R[order], belief.sigma[order]), order)
        np.testing.assert_allclose(shuffled, rows[order], atol=1e-6)

    holds()


@pytest.mark.parametrize("name", ["bps", "vec_bps"])
def test_basis_point_sets_of_every_object(meshes: MeshTable, name: str) -> None:
    """Far off, at the origin and around each basis point: finite, never longer than the way to the object's centre."""
    shape, count = encoding(name, meshes), len(OBJECTS)
    for place in ([0.0, 0.0, 0.0], [10.0, -10.0, 10.0], [1e-12, 0.0, 0.0], [0.03, 0.03, 0.03]):
        for R in octahedral()[[0, 5, 23]]:
            x = torch.tensor([place] * count, dtype=torch.float32)
            rows = shape(x, torch.from_numpy(R).float().repeat(count, 1, 1), torch.arange(count))
            lengths = rows.reshape(count, 64, -1).norm(dim=2)
            assert torch.isfinite(rows).all() and (lengths <= x.norm(dim=1)[:, None] + 0.2).all()


@settings(max_examples=50)
@given(seeds, st.floats(0, 10), st.floats(1e-6, 1))
def test_rewards_are_finite_and_turning_is_bounded(seed: int, far: float, clip: float) -> None:
    rng, config = np.random.default_rng(seed), RewardConfig(rotation_clip=clip)
    before, after = rng.uniform(0, np.pi, (2, 8))
    x = rng.uniform(-far, far, (3, 8, 3))
    terms = reward_terms(config, before, after, *x, rng.uniform(-2, 2, (8, 12)))
    assert all(np.isfinite(values).all() and values.shape == (8,) for values in terms.values())
    assert (terms["rotation"] <= config.rotation * clip).all() and (terms["rotation"] >= -np.pi).all()
    assert (terms["posture"] <= 0).all()


@pytest.fixture(scope="module")
def env():
    made = ReorientEnv(TASK)
    yield made
    made.close()


any_number = st.one_of(st.floats(-2, 2), st.floats(allow_nan=False, allow_infinity=False))
no_number = st.sampled_from([np.nan, np.inf, -np.inf])


@settings(max_examples=20)
@given(st.lists(arrays(np.float64, 12, elements=any_number), min_size=1, max_size=3), seeds)
def test_any_finite_action_is_its_clipped_self(
    env: ReorientEnv, actions: list[np.ndarray], seed: int
) -> None:
    spec, courses = EpisodeSpec(seed % 2, seed % 2, np.eye(3), seed), []
    for change in (lambda action: action, lambda action: np.clip(action, -1, 1)):
        course = [env.reset(options={"episode": spec})[0]]
        for action in actions:
            observation, reward, terminated, _, info = env.step(change(action))
            assert env.observation_space.contains(observation) and np.isfinite(observation).all()
            assert np.isfinite(reward) and info["fault"] is None
            command = env.simulator.world.command
            assert (command >= kinematics.JOINT_LOWER - 1e-9).all()
            assert (command <= kinematics.JOINT_UPPER + 1e-9).all()
            course.append(observation)
            if terminated:
                break
        courses.append(course)
    for one, other in zip(*courses, strict=True):
        np.testing.assert_array_equal(one, other)


@settings(max_examples=15)
@given(arrays(np.float64, 12, elements=any_number), no_number, st.integers(0, 11))
def test_any_other_action_is_an_error(env: ReorientEnv, action: np.ndarray, bad: float, place: int) -> None:
    first, _ = env.reset(options={"episode": EpisodeSpec(0, 0, np.eye(3), 3)})
    action[place] = bad
    with pytest.raises(ActionError, match="finite"):
        env.step(action)
    # Nothing was played: the episode goes on from where it stood.
    again, _ = env.reset(options={"episode": EpisodeSpec(0, 0, np.eye(3), 3)})
    np.testing.assert_array_equal(again, first)
