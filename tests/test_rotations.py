"""Rotations: round trips, the geodesic metric, the octahedral group, uniform draws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.spatial.transform import Rotation

from tactile_kit.rotations import (
    exp,
    from_quaternion,
    geodesic,
    log,
    octahedral,
    random_rotations,
    to_6d,
    to_quaternion,
)

numbers = st.floats(-1, 1, allow_nan=False)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
rotations = st.integers(0, 2**32 - 1).map(lambda seed: random_rotations(np.random.default_rng(seed), 1)[0])
angles = st.floats(1e-9, np.pi - 1e-6)


def axis_of(vector: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vector)
    return vector / length if length > 1e-3 else np.array([0.6, 0.0, -0.8])


@given(vectors, angles)
def test_exp_and_log_undo_each_other(vector: np.ndarray, angle: float) -> None:
    turn = angle * axis_of(vector)
    np.testing.assert_allclose(log(exp(turn)), turn, atol=1e-8)


@given(rotations)
def test_log_and_exp_undo_each_other(R: np.ndarray) -> None:
    np.testing.assert_allclose(exp(log(R)), R, atol=1e-12)


@given(vectors, angles)
def test_exp_turns_about_the_axis_by_the_angle(vector: np.ndarray, angle: float) -> None:
    axis = axis_of(vector)
    R = exp(angle * axis)
    np.testing.assert_allclose(R @ axis, axis, atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    across = np.cross(axis, [0.3, 0.5, 0.7])
    # Rodrigues' formula for a vector across the axis
    np.testing.assert_allclose(
        R @ across, np.cos(angle) * across + np.sin(angle) * np.cross(axis, across), atol=1e-12
    )


@given(rotations)
def test_six_numbers_are_the_first_two_columns(R: np.ndarray) -> None:
    six = to_6d(R)
    np.testing.assert_array_equal(six, [*R[:, 0], *R[:, 1]])


@given(rotations)
def test_quaternions_come_back_and_are_scalar_last(R: np.ndarray) -> None:
    quaternion = to_quaternion(R)
    assert quaternion.shape == (4,) and np.linalg.norm(quaternion) == pytest.approx(1)
    np.testing.assert_allclose(from_quaternion(quaternion), R, atol=1e-12)
    np.testing.assert_allclose(from_quaternion(-quaternion), R, atol=1e-12)


def test_quaternion_of_a_quarter_turn_about_z() -> None:
    half = np.sqrt(0.5)
    np.testing.assert_allclose(
        from_quaternion(np.array([0, 0, half, half])), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12
    )


@given(rotations, rotations, rotations)
def test_the_geodesic_angle_is_a_metric_that_turning_leaves_alone(
    A: np.ndarray, B: np.ndarray, C: np.ndarray
) -> None:
    d = geodesic
    assert d(A, A) == 0
    assert 0 <= d(A, B) <= np.pi + 1e-12
    assert d(A, B) == pytest.approx(d(B, A))
    assert d(A, C) <= d(A, B) + d(B, C) + 1e-7
    assert d(C @ A, C @ B) == pytest.approx(d(A, B), abs=1e-6)
    assert d(A @ C, B @ C) == pytest.approx(d(A, B), abs=1e-6)
    assert d(A, B) == pytest.approx(Rotation.from_matrix(A @ B.T).magnitude(), abs=1e-6)


@given(rotations, vectors, st.floats(1e-9, np.pi))
def test_the_geodesic_angle_is_the_angle(A: np.ndarray, vector: np.ndarray, angle: float) -> None:
    assert geodesic(exp(angle * axis_of(vector)) @ A, A) == pytest.approx(angle, rel=1e-6, abs=1e-12)


@given(
    rotations,
    vectors,
    st.one_of(st.floats(1e-6, np.pi), st.floats(1e-6, 1e-2).map(lambda small: np.pi - small)),
)
def test_the_geodesic_angle_keeps_its_digits_in_float32(
    A: np.ndarray, vector: np.ndarray, angle: float
) -> None:
    """Also near pi, where the chord alone has half of them."""
    turned = (exp(angle * axis_of(vector)) @ A).astype(np.float32)
    found = geodesic(turned, A.astype(np.float32))
    assert found.dtype == np.float32 and found == pytest.approx(angle, abs=2e-6)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_batches_are_rows(seed: int) -> None:
    R = random_rotations(np.random.default_rng(seed), 6).reshape(2, 3, 3, 3)
    for function in (to_6d, log, to_quaternion):
        whole = function(R)
        assert whole.shape[:2] == (2, 3)
        np.testing.assert_allclose(whole[1, 2], function(R[1, 2]))
    assert exp(log(R)).shape == R.shape
    assert geodesic(R, R[0, 0]).shape == (2, 3)
    assert to_6d(R.astype(np.float32)).dtype == np.float32


def test_the_octahedral_group() -> None:
    group = octahedral()
    assert group.shape == (24, 3, 3)
    np.testing.assert_array_equal(group[0], np.eye(3))
    np.testing.assert_allclose(np.linalg.det(group), 1)
    distances = geodesic(group[:, None], group[None])
    assert distances[~np.eye(24, dtype=bool)].min() > np.pi / 2 - 1e-9
    products = np.einsum("aij,bjk->abik", group, group).reshape(-1, 3, 3)
    nearest = geodesic(products[:, None], group[None]).min(axis=1)
    np.testing.assert_allclose(nearest, 0, atol=1e-12)  # closed
    # 1 identity, 6 + 8 + 9 turns by 90, 120 and 180 degrees
    np.testing.assert_array_equal(
        np.bincount(np.rint(np.rad2deg(distances[0])).astype(int), minlength=181)[[0, 90, 120, 180]],
        [1, 6, 8, 9],
    )


def test_random_rotations_are_uniform() -> None:
    """Haar measure: the angle has density (1 - cos) / pi, columns are uniform on the sphere, a turn changes nothing."""
    R = random_rotations(np.random.default_rng(0), 20000)
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1)
    for centre in (np.eye(3), exp(np.array([1.0, -0.5, 0.3]))):
        angle = geodesic(R, centre)
        assert stats.kstest(angle, lambda a: (a - np.sin(a)) / np.pi).pvalue > 1e-3
    for row in range(3):
        for column in range(3):
            assert stats.kstest(R[:, row, column], stats.uniform(-1, 2).cdf).pvalue > 1e-3


def test_random_rotations_follow_their_generator() -> None:
    one, two = (random_rotations(np.random.default_rng(4), 3) for _ in range(2))
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(random_rotations(np.random.default_rng(4), 2), one[:2])
