"""Compiled tip positions are the kinematics' own, and joint angles lead where they should."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_kit.hand import inverse, kinematics

LOWER, UPPER = kinematics.JOINT_LOWER, kinematics.JOINT_UPPER


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=12, max_size=12))
def test_tips_are_those_of_the_kinematics(shares: list[float]) -> None:
    joints = LOWER + np.array(shares) * (UPPER - LOWER)
    np.testing.assert_allclose(inverse.tips(joints), kinematics.tip_centres(joints), atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_angles_lead_to_tips_that_can_be_reached(seed: int) -> None:
    generator = np.random.default_rng(seed)
    there = np.clip(kinematics.MEAN_GRASP + generator.uniform(-0.15, 0.25, 12), LOWER, UPPER)
    wanted = kinematics.tip_centres(there)
    found = inverse.joints_for(wanted, kinematics.MEAN_GRASP)
    assert (found >= LOWER).all() and (found <= UPPER).all()
    np.testing.assert_allclose(kinematics.tip_centres(found), wanted, atol=1e-3)


def test_out_of_reach_a_finger_stretches_as_far_as_it_goes() -> None:
    away = kinematics.tip_centres(kinematics.MEAN_GRASP) - [0.0, 0.0, 0.1]
    found = inverse.joints_for(away, kinematics.MEAN_GRASP)
    assert np.isfinite(found).all() and (found >= LOWER).all() and (found <= UPPER).all()
    before = np.linalg.norm(kinematics.tip_centres(kinematics.MEAN_GRASP) - away, axis=1)
    after = np.linalg.norm(kinematics.tip_centres(found) - away, axis=1)
    assert (after < before).all()


def test_many_hands_are_the_single_ones() -> None:
    generator = np.random.default_rng(0)
    joints = generator.uniform(LOWER, UPPER, (200, 12))
    tips = inverse.tips_of_many(joints)
    np.testing.assert_allclose(tips, np.stack([inverse.tips(one) for one in joints]), atol=1e-12)
    wanted = tips + generator.normal(
        0.0, 0.02, tips.shape
    )  # also out of reach, and against the joints' limits
    alone = np.stack([inverse.joints_for(aim, near) for aim, near in zip(wanted, joints, strict=True)])
    np.testing.assert_allclose(inverse.joints_for_many(wanted, joints), alone, atol=1e-7)
    assert ((alone == LOWER) | (alone == UPPER)).any()
