"""Observations: sizes of every encoding's layout, and what stands in each term."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tactile_kit.rotations import exp, geodesic, random_rotations, to_6d
from tactile_kit.shape import ENCODINGS
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.core import Core
from tactile_kit.task.observation import Belief, goal_term

# Inputs of the network but for pointnet, whose 64 features are learned from 256 points: oracle and tactile.
SIZES = {
    "vec_bps": (351, 353),
    "bps": (223, 225),
    "pointnet": (144 + 6 + 768 + 9, 144 + 6 + 768 + 9 + 2),
    "pos_rot": (159, 161),
    "mesh": (351, 353),
    "pos": (153, 155),
    "none": (150, 152),
}


def core_of(variants, encoding: str, sigma: bool = False, **settings) -> Core:
    return Core(
        TaskConfig(objects="cube,l_shape", grasps=2, encoding=encoding, **settings),
        sigma=sigma,
        variants=variants,
    )


def test_every_encoding_has_its_size_here() -> None:
    assert set(SIZES) == set(ENCODINGS)


@pytest.mark.parametrize("name", SIZES)
def test_layout(variants, name: str) -> None:
    for sigma, size in zip((False, True), SIZES[name], strict=True):
        layout = core_of(variants, name, sigma).layout
        assert layout.size == size
        ends = 0
        for term in layout:  # gapless, in order
            assert layout[term].start == ends and layout.slice(term) == layout[term]
            ends = layout[term].stop
        assert ends == size
        assert list(layout)[:2] == ["joints", "goal"]


def test_the_papers_text_leaves_the_pose_out(variants) -> None:
    core = core_of(variants, "vec_bps", pose_in_observation=False)
    assert core.layout.sizes == {"joints": 144, "goal": 6, "shape": 192}
    assert core_of(variants, "pos_rot", pose_in_observation=False).layout.size == 159  # its shape is the pose


@pytest.mark.parametrize("name", SIZES)
def test_contents(variants, name: str) -> None:
    core = core_of(variants, name, sigma=True)
    rng = np.random.default_rng(0)
    z = rng.normal(size=(3, 144)).astype(np.float32)
    goal, R = random_rotations(rng, 3), random_rotations(rng, 3).astype(np.float32)
    x, sigma = rng.normal(0, 0.01, (3, 3)).astype(np.float32), rng.uniform(size=(3, 2)).astype(np.float32)
    given = np.array([1, 0, 1])
    seen = core.observer(z, goal, Belief(x, R, sigma), given)
    assert seen.dtype == np.float32 and seen.shape == (3, core.layout.size)
    np.testing.assert_array_equal(seen[:, core.layout["joints"]], z)
    np.testing.assert_array_equal(seen[:, core.layout["sigma"]], sigma)
    left = to_6d(goal @ np.swapaxes(R, 1, 2))  # turning by it reaches the goal
    np.testing.assert_allclose(seen[:, core.layout["goal"]], left, atol=1e-5)
    if "pose" in core.layout:
        np.testing.assert_array_equal(seen[:, core.layout["pose"]], np.concatenate([x, to_6d(R)], axis=1))
    if name == "none":
        assert "shape" not in core.layout
    else:
        shape = core.encoding(torch.tensor(x), torch.tensor(R), torch.tensor(given)).detach().numpy()
        np.testing.assert_array_equal(seen[:, core.layout["shape"]], shape)


def test_what_is_left_to_turn_is_in_the_hand_frame() -> None:
    """A quarter turn about the hand's z is left, however the object is turned now."""
    quarter = exp(np.array([0, 0, np.pi / 2]))
    for R in random_rotations(np.random.default_rng(0), 5):
        np.testing.assert_allclose(goal_term(quarter @ R, R), [0, 1, 0, -1, 0, 0], atol=1e-12)
        assert geodesic(quarter @ R, R) == pytest.approx(np.pi / 2)


@pytest.mark.parametrize("name", SIZES)
def test_some_rows_alone_are_those_of_all(variants, name: str) -> None:
    """To the bit: only environments that begin an episode are observed a second time."""
    core, rng = core_of(variants, name, sigma=True), np.random.default_rng(0)
    z, goal = rng.standard_normal((9, 144)).astype(np.float32), random_rotations(rng, 9)
    R, x = random_rotations(rng, 9).astype(np.float32), rng.normal(0, 0.01, (9, 3)).astype(np.float32)
    belief, given = Belief(x, R, rng.random((9, 2), np.float32)), np.arange(9) % 2
    for rows in (np.array([4]), np.array([1, 2, 8])):
        alone = core.observer(z[rows], goal[rows], belief.of(rows), given[rows])
        np.testing.assert_array_equal(alone, core.observer(z, goal, belief, given)[rows])
