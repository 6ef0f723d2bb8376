"""The impedance law by itself: static torque, limit, series spring, damping, weight, and the command filter."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_kit.hand import kinematics
from tactile_kit.hand.controller import CommandFilter, Impedance, ImpedanceController, gravity_torques

REST = kinematics.expand(kinematics.MEAN_GRASP)
STILL = np.zeros(16)
DRIVEN = kinematics.DRIVEN_INDEX


@pytest.mark.parametrize("rate", [60, 120, 240, 600])
def test_torque_at_rest_is_stiffness_times_error_whatever_the_step(rate: int) -> None:
    controller = ImpedanceController(Impedance(), 1 / rate, gravity=0.0)
    error = np.linspace(-0.2, 0.2, 12)
    torques = controller.torques(REST, STILL, kinematics.MEAN_GRASP + error)
    # motor spring 5 and series spring 25 Nm/rad one behind the other
    np.testing.assert_allclose(torques.ravel(), error / (1 / 5 + 1 / 25), rtol=1e-12)


def test_a_stiff_drive_leaves_the_controllers_stiffness() -> None:
    controller = ImpedanceController(Impedance(series_stiffness=1e9), 1 / 240, gravity=0.0)
    torques = controller.torques(REST, STILL, kinematics.MEAN_GRASP + 0.1)
    np.testing.assert_allclose(torques, 0.5, rtol=1e-6)


def test_torque_is_limited_to_one_newton_metre_either_way() -> None:
    controller = ImpedanceController(Impedance(), 1 / 60, gravity=0.0)
    for error in (0.24, 0.5, 3.0):
        np.testing.assert_allclose(controller.torques(REST, STILL, kinematics.MEAN_GRASP + error), 1.0)
        np.testing.assert_allclose(controller.torques(REST, STILL, kinematics.MEAN_GRASP - error), -1.0)
    assert controller.torques(REST, STILL, kinematics.MEAN_GRASP + 0.2)[0, 0] < 0.9


def test_motor_angles_divide_the_deflection_as_springs_do() -> None:
    controller = ImpedanceController(Impedance(), 1 / 60)
    q = np.zeros(12)
    # 0.12 rad of deflection: 5 Nm/rad (command to motor) takes 0.1 of it, 25 Nm/rad (motor to joint) 0.02
    np.testing.assert_allclose(controller.measured(q, q + 0.12), 0.02)
    np.testing.assert_allclose(controller.measured(q, q - 0.12), -0.02)
    # beyond the limit the series spring holds 1 Nm and stretches no further: 1/25 rad
    np.testing.assert_allclose(controller.measured(q, q + 0.9), 0.04)


def test_damping_works_against_the_speed_and_takes_energy_away() -> None:
    rng = np.random.default_rng(0)
    for rate in (60, 240):
        controller = ImpedanceController(Impedance(), 1 / rate, gravity=0.0)
        for _ in range(50):
            speed = kinematics.expand(rng.normal(size=12))
            torques = controller.torques(REST, speed, kinematics.MEAN_GRASP).copy()
            assert torques.ravel() @ speed[DRIVEN] < 1e-12


def test_damping_tends_to_the_continuous_law_with_the_step() -> None:
    speed = np.full(16, 0.7)
    controller = ImpedanceController(Impedance(), 1e-6, gravity=0.0)
    torques = controller.torques(REST, speed, kinematics.MEAN_GRASP)
    np.testing.assert_allclose(torques, -0.36 * 25 / 30 * 0.7, rtol=5e-3)


def test_weight_compensation_is_bullets_inverse_dynamics(loaded) -> None:
    client, body = loaded
    # inverse dynamics takes gravity in the frame of the fixed base
    client.setGravity(*(kinematics.HAND_ROTATION.T @ [0, 0, -9.81]).tolist())
    zero = [0.0] * 16
    weight = np.array(client.calculateInverseDynamics(body, REST.tolist(), zero, zero))
    client.setGravity(0, 0, 0)
    np.testing.assert_allclose(gravity_torques(9.81), weight, atol=1e-6)
    assert np.abs(weight).max() > 0.04  # it matters: a hundredth of a radian


def test_weight_compensation_follows_gravity() -> None:
    controller = ImpedanceController(Impedance(), 1 / 60, gravity=9.81)
    at_rest = controller.torques(REST, STILL, kinematics.MEAN_GRASP).copy()
    controller.compensate(0.981)
    np.testing.assert_allclose(
        controller.torques(REST, STILL, kinematics.MEAN_GRASP), at_rest / 10, atol=1e-15
    )


def test_filter_is_the_exact_first_order_response() -> None:
    for step in (1 / 60, 1 / 240):
        low_pass = CommandFilter(0.27, step)
        start, target = np.full(12, 0.3), np.linspace(-1, 1, 12)
        low_pass.reset(start)
        for number in range(1, 50):
            value = low_pass.update(target)
            exact = target + (start - target) * np.exp(-number * step / 0.27)
            np.testing.assert_allclose(value, exact, atol=1e-13)


def test_filter_keeps_no_hold_on_what_it_was_given() -> None:
    low_pass, start = CommandFilter(), np.zeros(12)
    low_pass.reset(start)
    start += 1
    np.testing.assert_array_equal(low_pass.value, 0)
