"""The Kalman baseline on hand-made contacts whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from estimator_cases import CUBE, CUBOID, boxes
from scipy.optimize import least_squares

from tactile_kit.estimator import EstimatorError, KalmanConfig, KalmanFilter
from tactile_kit.estimator.kalman import _contact
from tactile_kit.hand import kinematics
from tactile_kit.shape import encoding
from tactile_kit.task import rotations

GRASP = kinematics.MEAN_GRASP
MESH = torch.zeros(1, dtype=torch.int64)


def measured(first: np.ndarray, last: np.ndarray, error: float) -> torch.Tensor:
    """A window that goes evenly from joints ``first`` to ``last``, all flexion errors alike."""
    window = np.stack([first + share * (last - first) for share in np.linspace(0, 1, 6)])
    errors = np.tile([0.0, error, error], (6, 4))
    return torch.from_numpy(np.stack([window, errors], axis=1).reshape(1, 144)).float()


def joints_with_tips(targets: np.ndarray) -> np.ndarray:
    found = least_squares(lambda q: (kinematics.tip_centres(q) - targets).ravel() * 100, GRASP)
    assert np.abs(found.fun).max() < 0.05  # half a millimetre
    return found.x


def gaps(state, triangles) -> np.ndarray:
    frames = kinematics.link_frames(GRASP)[:, 3]
    x, R = state.x[0].double().numpy(), state.R[0].double().numpy()
    return (
        np.array([_contact(frame, x, R, triangles)[0] for frame in frames]) - kinematics.DISTAL.capsule.radius
    )


def test_contact_distance_and_slope_of_a_box() -> None:
    triangles = boxes(CUBOID).triangles(0)
    rng = np.random.default_rng(0)
    frame = np.eye(4)
    for _ in range(20):
        frame[:3, 3] = 0.08 * rng.standard_normal(3)
        x, R = 0.01 * rng.standard_normal(3), rotations.random_rotations(rng, 1)[0]
        distance, surface, normal = _contact(frame, x, R, triangles)
        along = np.linspace(0.0159, 0.0331, 3)
        local = (frame[:3, 3] + along[:, None] * [0, 1, 0] - x) @ R
        outside = np.maximum(np.abs(local) - np.array(CUBOID) / 2, 0)
        if (outside.sum(axis=1) == 0).any():
            assert distance < 0
            continue
        assert distance == pytest.approx(np.linalg.norm(outside, axis=1).min(), abs=1e-12)
        slope = -np.concatenate([normal, np.cross(surface - x, normal)])
        for axis, step in enumerate(1e-7 * np.eye(6)):
            moved = _contact(frame, x + step[:3], rotations.exp(step[3:]) @ R, triangles)[0]
            assert (moved - distance) / 1e-7 == pytest.approx(slope[axis], abs=1e-4)


def test_contacts_pull_a_wrong_start_to_the_fingers() -> None:
    table = boxes(CUBE)
    shape, kalman = encoding("none", table), KalmanFilter()
    state = kalman.initial(torch.eye(3)[None])
    state = state._replace(x=torch.tensor([[0.012, 0.009, 0.0]]))
    before, spread = np.abs(gaps(state, table.triangles(0))).mean(), kalman.sigmas(state)
    for _ in range(5):
        state = kalman(state, measured(GRASP, GRASP, 0.1), shape, MESH)
    after = np.abs(gaps(state, table.triangles(0))).mean()
    assert after < 0.5 * before
    assert kalman.sigmas(state)[0, 0] < spread[0, 0]
    variance = state.latent.reshape(6, 6).diagonal()
    assert variance[:2].max() < 0.1 * variance[2]  # no finger says how high the object sits
    assert torch.linalg.eigvalsh(state.latent.reshape(6, 6)).min() > 0


def test_without_contact_the_pose_rests_and_certainty_fades() -> None:
    shape, kalman = encoding("none", boxes((0.03, 0.03, 0.03))), KalmanFilter()
    R0 = torch.from_numpy(rotations.random_rotations(np.random.default_rng(0), 1)).float()
    state = kalman.initial(R0)
    after = kalman(state, measured(GRASP, GRASP - np.tile([0, 0.05, 0.05], 4), 0.0), shape, MESH)
    torch.testing.assert_close(after.R, R0)
    torch.testing.assert_close(after.x, state.x)
    assert (kalman.sigmas(after) > kalman.sigmas(state)).all()


@pytest.mark.parametrize("carry", [True, False])
def test_touching_tips_carry_the_object(carry: bool) -> None:
    """All tips go round the vertical axis by 0.1 rad: a carried object turns with them, a resting one doesn't."""
    turn = rotations.exp(np.array([0.0, 0.0, -0.1]))
    first, last = GRASP, joints_with_tips(kinematics.tip_centres(GRASP) @ turn.T)
    window_end = first + (last - first) * 5 / 6
    shape, kalman = encoding("none", boxes(CUBE)), KalmanFilter(KalmanConfig(carry=carry))
    state = kalman(kalman.initial(torch.eye(3)[None]), measured(first, window_end, 0.1), shape, MESH)
    angle = rotations.log(state.R[0].double().numpy())
    if carry:
        assert -0.15 < angle[2] < -0.05
        assert rotations.geodesic(state.R[0].double().numpy(), turn) < 0.05
    else:
        assert abs(angle[2]) < 0.05


def test_wrong_measurements_are_refused() -> None:
    kalman = KalmanFilter()
    with pytest.raises(EstimatorError, match=r"12.*144"):
        kalman(kalman.initial(torch.eye(3)[None]), torch.zeros(1, 12), encoding("none", boxes(CUBE)), MESH)
