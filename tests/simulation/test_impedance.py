"""The impedance-controlled hand in Bullet: what it does must not depend on the physics step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import randomization
from tactile_kit.hand import kinematics
from tactile_kit.hand.kinematics import DISTAL, DRIVEN_INDEX, MEAN_GRASP
from tactile_kit.simulation.world import World

RATES = [60, 120, 240, 600]
NO_FRICTION = np.zeros(12)


def press(world: World, joint: int, deflection: float) -> tuple[np.ndarray, np.ndarray]:
    """Finger 1 turns ``joint`` against a fixed smooth ball.

    Returns the contact's torques about the finger's joints ``(4,)`` and the errors of its driven joints ``(3,)``.
    """
    bullet = world.bullet
    tip, ahead = kinematics.tip_centres(MEAN_GRASP)[0], MEAN_GRASP.copy()
    ahead[joint] += 1e-5
    way = kinematics.tip_centres(ahead)[0] - tip
    way /= np.linalg.norm(way)
    shape = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=0.02)
    place = tip + way * (0.02 + DISTAL.capsule.radius + 5e-4)
    wall = bullet.createMultiBody(0, shape, basePosition=place.tolist())
    bullet.changeDynamics(wall, -1, lateralFriction=0.0)
    target = MEAN_GRASP.copy()
    target[joint] += deflection
    for _ in range(30):
        world.step(target)
    frames = kinematics.link_frames(world.joints[DRIVEN_INDEX])[0]
    torques = np.zeros(4)
    for contact in world.hand.contacts(wall):
        force = np.array(contact[7]) * contact[9]  # the normal points to the first body
        for j in range(4):
            torques[j] += force @ np.cross(frames[j, :3, 2], np.array(contact[5]) - frames[j, :3, 3])
    return torques, (world.command - world.joints[DRIVEN_INDEX])[:3]


@pytest.mark.parametrize("joint", [1, 2])
def test_force_on_a_wall_is_stiffness_times_error_at_every_rate(free_hand, joint: int) -> None:
    """Else touch would mean something else at every step: the error is all that the hand feels with."""
    stiffness = 5 * 25 / 30
    found = []
    for rate in RATES:
        torques, error = press(free_hand(rate, stick_friction=NO_FRICTION, gravity=0.0), joint, 0.1)
        assert -torques[joint] > 0.02
        felt = kinematics.TENDON.T @ torques  # q3 drives two joints
        np.testing.assert_allclose(-felt[1:], stiffness * error[1:], rtol=0.02, atol=2e-3)
        found.append(torques[joint])
    assert np.ptp(found) < 0.02 * np.abs(found).max()


def test_force_never_exceeds_the_torque_limit(free_hand) -> None:
    torques, error = press(free_hand(240, stick_friction=NO_FRICTION, gravity=0.0), 1, 1.2)
    assert error[1] > 0.5
    assert -torques[1] == pytest.approx(1.0, abs=0.02)


def test_stick_friction_takes_its_share_of_a_small_force(free_hand) -> None:
    """A joint that sticks passes on less than K e; without friction the same command moves it all the way."""
    command = MEAN_GRASP.copy()
    command[1] += 0.015  # 0.06 Nm
    moved = []
    for stick in (0.0, 0.02, 0.1):
        world = free_hand(240, stick_friction=np.full(12, stick), gravity=0.0)
        for _ in range(25):
            world.step(command)
        moved.append(world.joints[1] - MEAN_GRASP[1])
    assert moved[0] == pytest.approx(0.015, abs=5e-4)
    assert moved[1] == pytest.approx(0.015 - 0.02 / (5 * 25 / 30), abs=2e-3)
    assert abs(moved[2]) < 1e-4


def test_series_spring_softens_the_joint(free_hand) -> None:
    forces = []
    for series in (10.0, 1000.0):
        torques, error = press(
            free_hand(240, stick_friction=NO_FRICTION, gravity=0.0, series_stiffness=series), 1, 0.1
        )
        stiffness = 5 * series / (5 + series)
        assert -torques[1] == pytest.approx(stiffness * error[1], rel=0.02)
        forces.append(-torques[1])
    assert forces[1] > 1.3 * forces[0]


def test_free_motion_is_the_same_at_every_rate(free_hand) -> None:
    target = MEAN_GRASP + np.tile([0.1, 0.2, 0.3], 4)
    courses = []
    for rate in RATES:
        world, course = free_hand(rate, touch=False), []
        for _ in range(12):
            world.step(target)
            course.append(world.joints[DRIVEN_INDEX].copy())
        courses.append(course)
    for course in courses[:-1]:
        np.testing.assert_allclose(course, courses[-1], atol=0.04)  # two coarse steps of lead at the fastest
        np.testing.assert_allclose(course[-1], courses[-1][-1], atol=0.005)


def test_a_free_joint_follows_the_filtered_command(free_hand) -> None:
    """Paper, section II-C: first-order filter, then the impedance law, whose own lag is D/K = 72 ms."""
    world = free_hand(600, touch=False, stick_friction=NO_FRICTION, gravity=0.0)
    step, lag, filtering = 0.3, 0.36 / 5, 0.27
    target = MEAN_GRASP.copy()
    target[1::3] += step
    for number in range(1, 10):
        world.step(target)
        time = 0.1 * number
        left = (filtering * np.exp(-time / filtering) - lag * np.exp(-time / lag)) / (filtering - lag)
        expected = MEAN_GRASP[1::3] + step * (1 - left)
        np.testing.assert_allclose(world.joints[1::4], expected, atol=0.02)


@pytest.mark.parametrize("rate", RATES)
def test_free_fingers_come_to_rest_in_every_posture(free_hand, rate: int) -> None:
    """Without friction to hold them, at the stiffest and least damped gains of any preset."""
    terms = {name: randomization.preset("strong").terms[name].distribution.support() for name in ("kp", "kd")}
    gains = {"kp": terms["kp"][1], "kd": terms["kd"][0], "series_stiffness": 50.0}
    rng = np.random.default_rng(0)
    for _ in range(3):
        joints = rng.uniform(0.9 * kinematics.JOINT_LOWER, 0.9 * kinematics.JOINT_UPPER)
        world = free_hand(rate, joints, touch=False, stick_friction=NO_FRICTION, gravity=0.0, **gains)
        for joint in range(16):  # a blow
            speed = 2.0 * (-1) ** (joint // 4 + min(joint % 4, 2))  # q4 as q3
            world.bullet.resetJointState(
                world.hand.fingers[joint // 4], joint % 4, world.joints[joint], speed
            )
        world.joints, world.speeds = world.hand.read()
        for _ in range(10):
            world.step(joints)
        np.testing.assert_allclose(world.speeds, 0, atol=0.01)
        np.testing.assert_allclose(world.joints[DRIVEN_INDEX], joints, atol=0.005)
        np.testing.assert_allclose(world.joints[3::4], world.joints[2::4], atol=0.005)
        world.close()


@pytest.mark.parametrize("gravity", [0.0, 0.981, 9.81])
def test_fingers_neither_sag_nor_rise(free_hand: Callable[..., World], gravity: float) -> None:
    world = free_hand(60, stick_friction=NO_FRICTION, gravity=gravity)
    for _ in range(10):
        world.step(MEAN_GRASP)
    np.testing.assert_allclose(world.joints[DRIVEN_INDEX], MEAN_GRASP, atol=1e-4)


def test_the_passive_joint_keeps_up_with_q3(free_hand) -> None:
    world = free_hand(60, touch=False)
    target = MEAN_GRASP.copy()
    target[2::3] += 0.8
    for _ in range(10):
        world.step(target)
        np.testing.assert_allclose(world.joints[3::4], world.joints[2::4], atol=0.05)
    np.testing.assert_allclose(world.joints[3::4], world.joints[2::4], atol=0.005)
