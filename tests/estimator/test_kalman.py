"""The Kalman baseline: against filterpy's own filter, and on hand-made contacts whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from estimator_cases import CUBE, CUBOID, boxes
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from pydantic import ValidationError
from scipy.optimize import least_squares

from tactile_kit import rotations
from tactile_kit.estimator import EstimatorError, KalmanConfig, KalmanFilter
from tactile_kit.estimator.fingers import MEMORY, fingers, spheres
from tactile_kit.estimator.kalman import COVARIANCE, Held, N, Pose, contacts, process
from tactile_kit.estimator.unscented import Unscented
from tactile_kit.hand import kinematics
from tactile_kit.shape import PoseError, encoding

GRASP = kinematics.MEAN_GRASP
MESH = torch.zeros(1, dtype=torch.int64)
STILL = KalmanConfig(home=10.0)  # no prior about the position, so that contacts speak alone
FLEXED = np.tile([0.0, 0.1, 0.1], 4)


def measured(q: np.ndarray, error: np.ndarray = FLEXED) -> torch.Tensor:
    """A step in which the joints behind the springs stand at ``q`` with control errors ``error``, rad."""
    window = np.stack([q + 0.2 * error, error])  # the spring gives a fifth of the control error
    return torch.from_numpy(np.tile(window[None], (6, 1, 1)).reshape(1, 144)).float()


def touching(distance: float) -> np.ndarray:
    """Joints at which the middle of each finger's pad is ``distance`` m from the grasp's centre, pointing inwards."""
    centre = spheres(GRASP[None])[0].reshape(4, 4, 3)[:, 1].mean(axis=0)

    def off(q: np.ndarray) -> np.ndarray:
        pads = spheres(q[None])[0].reshape(4, 4, 3)[:, 1].astype(float) - centre
        return np.concatenate([(np.linalg.norm(pads, axis=1) - distance) * 100, 1e-3 * (q - GRASP)])

    return least_squares(off, GRASP, diff_step=1e-4).x


def gaps(state, z: torch.Tensor, table) -> np.ndarray:
    seen = fingers(z[None], torch.ones(1, 1, dtype=torch.bool), torch.zeros(1, MEMORY)).steps()[0]
    return Held(seen, table, MESH).gaps(Pose(state.x, state.R)).numpy()[0]


@pytest.mark.parametrize("alpha", [0.4, 1.0])
def test_the_batch_is_filterpys_filter_on_each_state(alpha: float) -> None:
    """A bent process and measurement, three states at once, twenty steps: to rounding."""
    rng = np.random.default_rng(0)
    Q, noise = 0.01 * np.eye(3), np.diag([0.02, 0.05])
    x, P = (
        torch.from_numpy(rng.standard_normal((3, 3))),
        0.1 * torch.eye(3, dtype=torch.float64).repeat(3, 1, 1),
    )

    def f(points):
        return torch.stack(
            [points[..., 0] + 0.1 * points[..., 1].sin(), 0.9 * points[..., 1], points[..., 2] ** 2 / 3], -1
        )

    def h(points):
        return torch.stack([points[..., 0] ** 2 - 1, (points[..., 1] + points[..., 2]).clamp(max=0.2)], -1)

    def of_one(function):
        return lambda point, *_: function(torch.from_numpy(point)).numpy()

    references = []
    for row in x:
        rule = MerweScaledSigmaPoints(3, alpha, 2.0, 0.0)
        ukf = UnscentedKalmanFilter(3, 2, 1.0, of_one(h), of_one(f), rule)
        ukf.x, ukf.P, ukf.Q, ukf.R = row.numpy().copy(), 0.1 * np.eye(3), Q, noise
        references.append(ukf)
    unscented = Unscented(3, alpha, 2.0, 0.0)
    for _ in range(20):
        x, P = unscented.predict(x, P, f, torch.from_numpy(Q))
        x, P = unscented.update(x, P, h, torch.from_numpy(noise))
        for row, ukf in enumerate(references):
            ukf.predict()
            ukf.update(np.zeros(2))
            np.testing.assert_allclose(x[row].numpy(), ukf.x, atol=1e-8)
            np.testing.assert_allclose(P[row].numpy(), ukf.P, atol=1e-8)


def test_a_step_of_the_hand_is_filterpys() -> None:
    """The shipped process and contacts in filterpy's own filter give the shipped filter's pose and covariance."""
    table, kalman = boxes(CUBE), KalmanFilter()
    first, last = touching(0.04), touching(0.042)
    state = kalman.initial(torch.eye(3)[None])
    state = kalman(state, measured(first), encoding("none", table), MESH)
    z = measured(last)
    after = kalman(state, z, encoding("none", table), MESH)

    (seen,) = fingers(z[None], torch.zeros(1, 1, dtype=torch.bool), state.latent[:, COVARIANCE:]).steps()
    hand, at = Held(seen, table, MESH), Pose(state.x, state.R)
    carried = hand.carried(at)
    pressing = []

    def moved(point, dt):
        return process(hand, at, carried, torch.from_numpy(point)[None, None])[0, 0].numpy()

    def felt(point):
        return contacts(hand, carried, pressing[0], torch.from_numpy(point)[None, None])[0, 0].numpy()

    rule = MerweScaledSigmaPoints(N, kalman.config.alpha, 2.0, 0.0)
    ukf = UnscentedKalmanFilter(N, len(kalman.contact_noise), 1.0, felt, moved, rule)
    ukf.x, ukf.P = np.zeros(N), state.latent[0, :COVARIANCE].double().reshape(N, N).numpy()
    ukf.Q, ukf.R = kalman.process_noise.numpy(), kalman.contact_noise.numpy()
    ukf.predict()
    pressing.append(hand.shares(carried.moved(torch.from_numpy(ukf.x)[None])) > kalman.config.pressed)
    assert pressing[0].any()
    ukf.update(np.zeros(len(kalman.contact_noise)))
    expected = carried.moved(torch.from_numpy(ukf.x)[None])
    torch.testing.assert_close(after.x, expected.x, atol=1e-6, rtol=0)
    torch.testing.assert_close(after.R, expected.R, atol=1e-5, rtol=0)
    np.testing.assert_allclose(after.latent[0, :COVARIANCE].reshape(N, N).numpy(), ukf.P, atol=1e-6)


def test_contacts_pull_a_wrong_start_to_the_fingers() -> None:
    table = boxes((0.05, 0.05, 0.05))
    shape, kalman = encoding("none", table), KalmanFilter(STILL)
    z = measured(touching(0.043))
    state = kalman.initial(torch.eye(3)[None])._replace(x=torch.tensor([[0.012, 0.009, 0.0]]))
    before, spread = np.abs(gaps(state, z, table)).mean(), kalman.sigmas(state)
    for _ in range(8):
        state = kalman(state, z, shape, MESH)
    assert np.abs(gaps(state, z, table)).mean() < 0.5 * before
    assert torch.linalg.eigvalsh(state.latent[0, :COVARIANCE].reshape(N, N).double()).min() > 0
    assert torch.isfinite(kalman.sigmas(state)).all() and (spread > 0).all()


def test_a_finger_that_does_not_press_says_only_that_it_is_outside() -> None:
    seen = fingers(measured(GRASP)[None], torch.ones(1, 1, dtype=torch.bool), torch.zeros(1, MEMORY)).steps()[
        0
    ]
    free, zero = torch.zeros(1, 4, dtype=torch.bool), torch.zeros(1, 1, N, dtype=torch.float64)
    at = Pose(torch.zeros(1, 3), torch.eye(3)[None])
    small, large = (Held(seen, boxes((size,) * 3), MESH) for size in (0.01, 0.12))
    assert contacts(small, at, free, zero)[0, 0, :4].abs().max() == 0
    assert contacts(small, at, ~free, zero)[0, 0, :4].min() > 0.005
    assert (
        contacts(large, at, free, zero)[0, 0, :4].min() < -0.005
    )  # inside: refused whether it presses or not


def test_without_contact_the_pose_rests_and_certainty_fades_to_a_bound() -> None:
    shape, kalman = encoding("none", boxes((0.01, 0.01, 0.01))), KalmanFilter()
    R0 = torch.from_numpy(rotations.random_rotations(np.random.default_rng(0), 1)).float()
    state = kalman.initial(R0)
    open_hand = measured(GRASP - np.tile([0, 0.3, 0.3], 4), np.zeros(12))
    after = kalman(state, open_hand, shape, MESH)
    torch.testing.assert_close(after.R, R0)
    assert kalman.sigmas(after)[0, 1] > kalman.sigmas(state)[0, 1]
    for _ in range(300):
        after = kalman(after, open_hand, shape, MESH)
    assert after.x.norm() < 1e-3
    assert kalman.sigmas(after)[0, 1] == pytest.approx(3**0.5 * kalman.config.largest_rotation, rel=1e-3)


def test_pads_that_press_carry_the_object() -> None:
    """All pads go round the vertical axis by 0.1 rad; a cube between them turns along, and back."""
    turn = rotations.exp(np.array([0.0, 0.0, -0.1]))
    pads = spheres(GRASP[None])[0].reshape(4, 4, 3)[:, 1].astype(float)
    aim = pads @ turn.T

    def off(q: np.ndarray) -> np.ndarray:
        return ((spheres(q[None])[0].reshape(4, 4, 3)[:, 1] - aim) * 100).ravel()

    turned = least_squares(off, GRASP, diff_step=1e-4).x
    assert np.abs(off(turned)).max() < 0.1  # a millimetre
    table = boxes(CUBE)
    shape, kalman = encoding("none", table), KalmanFilter()
    state = kalman(kalman.initial(torch.eye(3)[None]), measured(GRASP), shape, MESH)
    for _ in range(3):  # settle
        state = kalman(state, measured(GRASP), shape, MESH)
    before = state.R[0].double().numpy()
    state = kalman(state, measured(turned), shape, MESH)
    moved = rotations.log(state.R[0].double().numpy() @ before.T)
    assert -0.15 < moved[2] < -0.04, moved
    state = kalman(state, measured(GRASP), shape, MESH)
    assert abs(rotations.log(state.R[0].double().numpy() @ before.T)[2]) < 0.03


def test_environments_do_not_touch_each_other() -> None:
    table, kalman = boxes(CUBE, CUBOID), KalmanFilter()
    z = torch.cat([measured(touching(0.04)), measured(GRASP), measured(touching(0.045))])
    mesh, R0 = torch.tensor([0, 1, 1]), torch.eye(3).repeat(3, 1, 1)
    shape = encoding("none", table)
    both = kalman(kalman.initial(R0), z, shape, mesh)
    for row in range(3):
        one = slice(row, row + 1)
        alone = kalman(kalman.initial(R0[one]), z[one], shape, mesh[one])
        torch.testing.assert_close(both.rows(one).R, alone.R, atol=1e-6, rtol=0)
        torch.testing.assert_close(both.rows(one).latent, alone.latent, atol=1e-6, rtol=1e-5)


def test_bad_input_is_refused() -> None:
    kalman, shape = KalmanFilter(), encoding("none", boxes(CUBE))
    state = kalman.initial(torch.eye(3)[None])
    with pytest.raises(EstimatorError, match=r"12.*144"):
        kalman(state, torch.zeros(1, 12), shape, MESH)
    with pytest.raises(PoseError, match=r"mesh\[0\] is 7"):
        kalman(state, measured(GRASP), shape, MESH + 7)
    with pytest.raises(ValidationError, match="contact_noise"):
        KalmanConfig(contact_noise=0.0)
    with pytest.raises(EstimatorError, match="allowed: > 0"):
        Unscented(3, 1.0, 2.0, -3.0)
