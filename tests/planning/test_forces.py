"""Taking over what lifted fingers bear: balance, friction, nothing where nothing is lifted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_kit.hand.inverse import ORIGINS, TIP, tip_of
from tactile_kit.hand.kinematics import MEAN_GRASP
from tactile_kit.planning import forces

Q = MEAN_GRASP.reshape(4, 3)
CENTRE = np.zeros(3)


def tip_forces(command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force ``(4, 3)`` N of every tip at ``Q``, and its lever ``(4, 3)`` m about the object."""
    force, lever = np.zeros((4, 3)), np.zeros((4, 3))
    for finger in range(4):
        tip, J = tip_of(ORIGINS[finger], Q[finger], TIP)
        force[finger] = np.linalg.solve(J.T, forces.STIFFNESS * (command[finger] - Q[finger]))
        lever[finger] = tip + forces.TIP_RADIUS * (CENTRE - tip) / np.linalg.norm(tip) - CENTRE
    return force, lever


def pressing(newtons: float) -> np.ndarray:
    """The command ``(4, 3)`` rad by which every tip presses towards the centre."""
    command = Q.copy()
    for finger in range(4):
        tip, J = tip_of(ORIGINS[finger], Q[finger], TIP)
        command[finger] += J.T @ (-tip / np.linalg.norm(tip) * newtons) / forces.STIFFNESS
    return command


@pytest.mark.parametrize("finger", range(4))
def test_the_others_bear_what_the_lifted_finger_bore(finger: int) -> None:
    command = pressing(3.0)
    lifted = np.arange(4) == finger
    change = forces.taken_over(ORIGINS, Q, command, CENTRE, lifted) / forces.SHARE
    before, lever = tip_forces(command)
    after, _ = tip_forces(command + change)
    rest = np.flatnonzero(~lifted)
    left = np.linalg.norm(before.sum(axis=0) - after[rest].sum(axis=0))
    assert left < 0.5 * np.linalg.norm(before[finger])
    torque = np.cross(lever, before).sum(axis=0) - np.cross(lever[rest], after[rest]).sum(axis=0)
    assert np.linalg.norm(torque) < 0.03
    inwards = -lever[rest] / np.linalg.norm(lever[rest], axis=1, keepdims=True)
    assert ((after[rest] * inwards).sum(axis=1) > 0).all()  # nobody pulls


def test_a_lifted_finger_s_own_command_stays() -> None:
    change = forces.taken_over(ORIGINS, Q, pressing(3.0), CENTRE, np.array([True, False, True, False]))
    np.testing.assert_array_equal(change[[0, 2]], 0.0)
    assert np.abs(change[[1, 3]]).max() > 0.0


def test_nothing_changes_where_all_hold_firmly() -> None:
    change = forces.taken_over(ORIGINS, Q, pressing(3.0), CENTRE, np.zeros(4, bool))
    np.testing.assert_allclose(change, 0.0, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_changes_are_finite_and_limited(seed: int) -> None:
    generator = np.random.default_rng(seed)
    command = Q + generator.normal(0.0, 0.3, (4, 3))
    lifted = generator.random(4) < 0.4
    change = forces.taken_over(ORIGINS, Q, command, generator.normal(0.0, 0.01, 3), lifted)
    assert np.isfinite(change).all() and np.abs(change).max() <= forces.FARTHEST
