"""MuJoCo's world beside Bullet's: the same hand, the same controller, the same fall, much the same friction."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np
import pytest

import randomization
from tactile_kit.errors import EngineError
from tactile_kit.hand import kinematics
from tactile_kit.hand.kinematics import DRIVEN_INDEX, MEAN_GRASP
from tactile_kit.rotations import exp, geodesic
from tactile_kit.simulation.banks import find_banks
from tactile_kit.simulation.batches import finder_of
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.engines import ENGINES, engine_of
from tactile_kit.simulation.episode import Status
from tactile_kit.simulation.simulator import Simulator
from tactile_kit.simulation.world import Grasp, PhysicsFault
from tactile_kit.simulation.worlds import world_of

mujoco = pytest.importorskip("mujoco")

MUJOCO = SimulationConfig(engine="mujoco", steps_per_second=1020)
FINE = SimulationConfig(steps_per_second=960, solver_iterations=100)
AWAY = np.array([0.0, 0.0, 2.0])
NO_FRICTION = np.zeros(12)


@pytest.fixture
def worlds(bodies, physics):
    """Both, with the object far off: MuJoCo and Bullet at about the same step."""
    made = []

    def make(body: int = 0, joints: np.ndarray = MEAN_GRASP, **changes):
        pair = [world_of(config) for config in (MUJOCO, FINE)]
        made.extend(pair)
        for world in pair:
            world.load(bodies[body], {**physics, **changes})
            world.place(Grasp(kinematics.expand(joints), joints, AWAY, np.eye(3)))
        return pair

    yield make
    for world in made:
        world.close()


@pytest.fixture(scope="module")
def grasps(things, own_cache):
    """Two grasps each of cube and L, found in MuJoCo."""
    finder = finder_of(MUJOCO, 2, 0.0)
    return find_banks(finder, [(things["cube"],), (things["l_shape"],)], quiet=True)[1]


def test_links_are_where_the_kinematic_table_puts_them(worlds) -> None:
    joints = np.random.default_rng(0).uniform(kinematics.JOINT_LOWER, kinematics.JOINT_UPPER)
    world, _ = worlds(joints=joints)
    frames = kinematics.link_frames(joints).reshape(-1, 4, 4)
    for number, frame in enumerate(frames):
        np.testing.assert_allclose(world.data.xpos[number + 1], frame[:3, 3], atol=1e-7)
        np.testing.assert_allclose(world.data.xmat[number + 1].reshape(3, 3), frame[:3, :3], atol=1e-7)


def test_the_mass_matrix_is_that_of_the_links_and_the_drives(worlds) -> None:
    world, _ = worlds()
    found = np.zeros((world.model.nv, world.model.nv))
    mujoco.mj_fullM(world.model, world.data, found)
    expected = kinematics.mass_matrix(MEAN_GRASP)
    expected[DRIVEN_INDEX, DRIVEN_INDEX] += 1.5e-3
    passive = np.arange(3, 16, 4)  # the coupled joint of each finger
    expected[passive, passive] += 3e-4
    expected[::4, ::4] += np.eye(4) * 1e-6  # what turns with the abduction alone
    np.testing.assert_allclose(found[:16, :16], expected, atol=1e-9)


def test_the_object_falls_and_turns_as_it_has_to(worlds) -> None:
    """Free fall, a force, and a torque about the vertical, for which the L's products of inertia don't matter."""
    for world in worlds(body=1):
        before = world.position
        for _ in range(5):
            world.step(MEAN_GRASP)
        np.testing.assert_allclose(world.position - before, [0, 0, -0.5 * 9.81 * 0.25], atol=0.012)
        world.set_gravity(0.0)
        world.place(Grasp(kinematics.expand(MEAN_GRASP), MEAN_GRASP, AWAY, np.eye(3)))
        world.disturb(np.array([0.05, 0.0, 0.0]), np.zeros(3))
        for _ in range(5):
            world.step(MEAN_GRASP)
        np.testing.assert_allclose(world.position - AWAY, [0.5 * 0.05 / 0.05 * 0.25, 0, 0], atol=3e-3)
    spins = []
    for world in worlds(body=0, gravity=0.0):
        world.disturb(np.zeros(3), np.array([0.0, 0.0, 1e-4]))
        for _ in range(5):
            world.step(MEAN_GRASP)
        spins.append(geodesic(world.rotation, np.eye(3)))
    expected = 0.5 * 1e-4 / (0.05 * 0.0675**2 / 6) * 0.25
    np.testing.assert_allclose(spins, expected, rtol=0.02)


def test_mass_offset_changes_mass_and_inertia_alike(worlds) -> None:
    world, _ = worlds(object_mass_offset=0.02, gravity=0.0)
    nominal, _ = worlds(gravity=0.0)
    assert world.model.body_mass[-1] == pytest.approx(0.07)
    np.testing.assert_allclose(world.model.body_inertia[-1], 1.4 * nominal.model.body_inertia[-1])
    world.disturb(np.array([0.07, 0.0, 0.0]), np.zeros(3))
    world.step(MEAN_GRASP)
    assert world.data.qvel[16] == pytest.approx(0.1, rel=1e-3)


def test_free_joints_answer_a_step_as_in_bullet(worlds) -> None:
    """Filter and impedance law: both follow the analytic course, q4 follows q3."""
    target, step, lag, filtering = MEAN_GRASP.copy(), -0.3, 0.36 / 5, 0.27  # opening: no finger meets another
    target[1::3] += step
    pair = worlds(stick_friction=NO_FRICTION, gravity=0.0)
    for number in range(1, 10):
        time = 0.1 * number
        left = (filtering * np.exp(-time / filtering) - lag * np.exp(-time / lag)) / (filtering - lag)
        for world in pair:
            world.step(target)
            np.testing.assert_allclose(world.joints[1::4], MEAN_GRASP[1::3] + step * (1 - left), atol=0.02)
            np.testing.assert_allclose(world.joints[3::4], world.joints[2::4], atol=5e-3)
        np.testing.assert_allclose(pair[0].q, pair[1].q, atol=6e-3)
        np.testing.assert_allclose(pair[0].e, pair[1].e, atol=6e-3)


def test_offsets_noise_and_the_series_spring_are_measured_as_in_bullet(worlds) -> None:
    offset = np.linspace(-0.04, 0.04, 12)
    noise = np.random.default_rng(1).normal(0, 0.02, (6, 12))
    pair = worlds(joint_offset=offset, series_stiffness=15.0, stick_friction=NO_FRICTION)
    np.testing.assert_allclose(pair[0].q, pair[1].q, atol=1e-9)
    for world in pair:
        np.testing.assert_allclose(world.command, MEAN_GRASP, atol=1e-12)
        world.step(MEAN_GRASP + 0.1, noise)
    np.testing.assert_allclose(pair[0].q, pair[1].q, atol=6e-3)
    np.testing.assert_allclose((pair[0].q + pair[0].e)[-1], pair[0].command, atol=1e-12)


def test_dry_friction_holds_a_joint_as_in_bullet(worlds) -> None:
    command = MEAN_GRASP.copy()
    command[1] += 0.015  # 0.06 Nm
    for stick, moved in ((0.0, 0.015), (0.02, 0.015 - 0.02 / (5 * 25 / 30)), (0.1, 0.0)):
        for world in worlds(stick_friction=np.full(12, stick)):
            for _ in range(20):
                world.step(command)
            assert world.joints[1] - MEAN_GRASP[1] == pytest.approx(moved, abs=2e-3)


def test_torque_is_stiffness_times_error_up_to_the_limit(worlds) -> None:
    world, _ = worlds(stick_friction=NO_FRICTION, kp=4.0, series_stiffness=16.0)
    target = MEAN_GRASP.copy()
    target[1] += 1.2
    largest = 0.0
    for _ in range(4):
        world.step(target)
        mujoco.mj_forward(world.model, world.data)
        error = world.command - world.joints[DRIVEN_INDEX]
        np.testing.assert_allclose(world.data.actuator_force, np.clip(3.2 * error, -1, 1), atol=0.02)
        largest = max(largest, world.data.actuator_force[1])
    assert largest == pytest.approx(1.0)


@pytest.mark.parametrize("coefficient", [0.3, 0.9])
def test_a_tip_rubs_along_a_face_by_its_coefficient(bodies, physics, coefficient: float) -> None:
    """A cube slides past a pressing tip: friction over normal force is the coefficient."""
    world = world_of(MUJOCO)
    world.load(bodies[0], {**physics, "gravity": 0.0, "tip_friction": coefficient})
    ball = kinematics.tip_centres(MEAN_GRASP)[1]
    pressed = 4e-3  # m, by which the cube is pushed against the tip
    place = ball - np.array([0.03375 + kinematics.DISTAL.capsule.radius - pressed, 0.0, 0.0])
    world.place(Grasp(kinematics.expand(MEAN_GRASP), MEAN_GRASP, place, np.eye(3)))
    world.data.qvel[17] = 0.2  # m/s, along the face
    mujoco.mj_step(world.model, world.data)
    ratios = {}
    for number in range(world.data.ncon):
        force = np.zeros(6)
        mujoco.mj_contactForce(world.model, world.data, number, force)
        if force[0] > 0.5:
            link = world.model.body(world.model.geom_bodyid[world.data.contact[number].geom[0]]).name
            ratios[link] = np.linalg.norm(force[1:3]) / force[0]
    assert ratios["f2_distal"] == pytest.approx(coefficient, rel=0.02)
    world.close()


def test_grasps_of_the_heuristic_hold_and_episodes_repeat_to_the_byte(bodies, grasps) -> None:
    simulator = Simulator(MUJOCO, bodies, grasps, randomization.preset("default"), 30)

    def play(variant: int, seed: int) -> tuple[str, list[Status]]:
        simulator.reset(variant, seed, 9.81)
        start = (simulator.world.command - 0.5 * (kinematics.JOINT_UPPER + kinematics.JOINT_LOWER)) / (
            0.5 * (kinematics.JOINT_UPPER - kinematics.JOINT_LOWER)
        )
        z, x, R, q = np.zeros(144, np.float32), np.zeros(3), np.eye(3), np.zeros(12)
        digest, ends = hashlib.sha256(), []
        for _ in range(10):
            ends.append(simulator.step(start))
            simulator.read(z, x, R, q)
            for array in (z, x, R, q):
                digest.update(array.tobytes())
        return digest.hexdigest(), ends

    first, ends = play(1, 7)
    assert ends == [Status.RUNNING] * 10  # it is still in the hand
    others = {play(number % 2, number)[0] for number in range(3)}
    assert len(others) == 3 and play(1, 7)[0] == first
    simulator.close()


def test_what_is_not_finite_is_a_fault(worlds) -> None:
    world, _ = worlds()
    with pytest.raises(PhysicsFault, match="BADCTRL"):
        world.step(np.full(12, np.nan))


def test_a_finger_in_the_object_is_seen(worlds) -> None:
    for world in worlds():
        assert world.overlap(anew=True) == 0.0
        place = kinematics.tip_centres(MEAN_GRASP)[0]
        world.place(Grasp(kinematics.expand(MEAN_GRASP), MEAN_GRASP, place, np.eye(3)))
        assert world.overlap(anew=True) > 0.02
        back = world.pin()
        world.step(MEAN_GRASP)
        assert world.pace()[0] > 0.01
        back()
        assert world.pace() == (0.0, 0.0)


def test_a_turned_object_is_read_back_in_its_canonical_frame(worlds) -> None:
    world, _ = worlds(body=1)
    rotation = exp(np.array([0.3, -1.0, 2.0]))
    world.place(Grasp(kinematics.expand(MEAN_GRASP), MEAN_GRASP, AWAY, rotation))
    np.testing.assert_allclose(world.position, AWAY, atol=1e-12)
    assert geodesic(world.rotation, rotation) < 1e-9


def test_what_is_wrong_is_said(things, physics, monkeypatch) -> None:
    with pytest.raises(EngineError, match=r"engine = 'mujocco' unknown; nearest.*'mujoco'"):
        engine_of("mujocco")
    with pytest.raises(ValueError, match=r"'warp' unknown.*bullet, compiled, mujoco"):
        SimulationConfig(engine="warp")
    with pytest.raises(EngineError, match=r"steps_per_second = 60.*from 500 on"):
        world_of(SimulationConfig(engine="mujoco"))
    with pytest.raises(EngineError, match="pictures"):
        world_of(MUJOCO, visible=True)
    world = world_of(MUJOCO)
    hollow = Body(things["cube"])
    hollow.thing = replace(things["cube"], parts=())
    with pytest.raises(EngineError, match="cube: no convex parts"):
        world.load(hollow, physics)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert not ENGINES["mujoco"].installed and ENGINES["bullet"].installed
    with pytest.raises(EngineError, match=r"mujoco is not installed.*tactile-kit\[transfer\]"):
        world_of(MUJOCO)
