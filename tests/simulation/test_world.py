"""The world: repeatable, measured in a fixed order, and disturbed when told."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import randomization
from tactile_kit.hand import kinematics
from tactile_kit.hand.kinematics import DRIVEN_INDEX, MEAN_GRASP
from tactile_kit.rotations import exp, geodesic
from tactile_kit.simulation.simulator import Simulator
from tactile_kit.simulation.world import LOADS_A_SCENE, Grasp, World

DIGEST_IN_A_NEW_PROCESS = """
import sys, hashlib
import numpy as np
import object_sets, randomization
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.banks import BulletFinder, find_banks
from tactile_kit.simulation.simulator import Simulator
things = [object_sets.load("all")[name] for name in ("cube", "l_shape")]
bank = find_banks(BulletFinder(2, SimulationConfig()), [[thing] for thing in things])[1]
simulator = Simulator(SimulationConfig(), [Body(thing) for thing in things], bank, randomization.preset("default"), 12)
{play}
print(play(simulator, 1, 77).hex())
"""

PLAY = '''
def play(simulator, variant, seed):
    """Digest of everything an episode of fixed actions shows."""
    simulator.reset(variant, seed, 9.81)
    rng = np.random.default_rng(seed)
    z, x, R, q = np.zeros(144, np.float32), np.zeros(3), np.eye(3), np.zeros(12)
    digest = hashlib.sha256()
    for _ in range(12):
        simulator.step(rng.uniform(-0.6, 0.2, 12))
        simulator.read(z, x, R, q)
        for array in (z, x, R, q):
            digest.update(array.tobytes())
    return digest.digest()
'''
_space: dict = {"np": np, "hashlib": hashlib}
exec(PLAY, _space)
play = _space["play"]


@pytest.fixture
def simulator(bodies, bank):
    made = []

    def make(preset: str = "default", horizon: int = 12, **settings) -> Simulator:
        from tactile_kit.simulation.config import SimulationConfig

        config = SimulationConfig(**settings.pop("config", {}))
        made.append(Simulator(config, bodies, bank, randomization.preset(preset), horizon, **settings))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_an_episode_repeats_itself_to_the_byte(simulator) -> None:
    """After twenty others, in another world, and in another process."""
    first = simulator()
    digest = play(first, 1, 77)
    others = {play(first, number % 2, number) for number in range(20)}
    assert len(others) == 20 and digest not in others
    assert play(first, 1, 77) == digest
    assert play(simulator(), 1, 77) == digest
    code = DIGEST_IN_A_NEW_PROCESS.format(play=PLAY)
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )
    assert run.stdout.split()[-1] == digest.hex()


def test_a_fresh_scene_now_and_then_keeps_memory_flat(simulator) -> None:
    """Bullet alone would keep about 2 MB of these removed bodies."""
    one = simulator()

    def resident_after(loads: int) -> int:
        for number in range(loads):
            one.reset(number % 2, number, 9.81)
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS"))

    before = resident_after(LOADS_A_SCENE + 100)
    assert resident_after(4 * LOADS_A_SCENE) - before < 800  # kB


def test_a_fresh_scene_changes_no_episode(simulator, monkeypatch) -> None:
    monkeypatch.setattr("tactile_kit.simulation.world.LOADS_A_SCENE", 2)
    one = simulator()
    assert len({play(one, 1, 77) for _ in range(5)}) == 1


def test_the_window_holds_angles_then_errors_oldest_first(simulator) -> None:
    """Fingers on the move: samples in order of time, and q + e is the filtered command of that moment."""
    one = simulator("none")
    one.reset(0, 0, 9.81)
    z, x, R, q = np.zeros(144, np.float32), np.zeros(3), np.eye(3), np.zeros(12)
    one.read(z, x, R, q)
    start = one.world.command.copy()
    np.testing.assert_array_equal(z.reshape(6, 2, 12), np.broadcast_to(z.reshape(6, 2, 12)[0], (6, 2, 12)))
    np.testing.assert_allclose(z.reshape(6, 2, 12)[0].sum(0), start, atol=1e-6)
    np.testing.assert_array_equal(R, one.world.rotation)
    open_hand = np.clip(
        MEAN_GRASP - np.tile([0, 0.4, 0.2], 4), kinematics.JOINT_LOWER, kinematics.JOINT_UPPER
    )
    half, middle = (
        (kinematics.JOINT_UPPER - kinematics.JOINT_LOWER) / 2,
        (kinematics.JOINT_UPPER + kinematics.JOINT_LOWER) / 2,
    )
    one.step((open_hand - middle) / half)
    one.read(z, x, R, q)
    window = z.reshape(6, 2, 12).astype(float)
    times = np.arange(1, 7)[:, None] / 60
    np.testing.assert_allclose(
        window.sum(1), open_hand + (start - open_hand) * np.exp(-times / 0.27), atol=1e-5
    )
    assert (np.diff(window[:, 0, 1:9:3], axis=0) < 0).all()  # q2 of the fingers opens, sample by sample
    error = one.world.command - q
    np.testing.assert_allclose(window[5, 1], 5 / 6 * error, atol=1e-3)  # the motor's share: 25 of 5 + 25


def test_a_known_place_is_read_back(make_world, bodies, physics) -> None:
    world, rotation = make_world(), exp(np.array([0.3, -1.0, 2.0]))
    for body in bodies:
        world.load(body, physics)
        place = np.array([0.4, 0.3, 0.2])
        world.place(Grasp(kinematics.expand(MEAN_GRASP), MEAN_GRASP, place, rotation))
        np.testing.assert_allclose(world.position, place, atol=1e-9)
        assert geodesic(world.rotation, rotation) < 1e-7


def fall(world: World, seconds: float) -> np.ndarray:
    """Displacement of the object, which the hand doesn't reach."""
    before = world.position
    for _ in range(round(10 * seconds)):
        world.step(MEAN_GRASP)
    return world.position - before


@pytest.mark.parametrize("gravity", [0.0, 0.981, 9.81])
def test_objects_fall_with_the_episodes_gravity(free_hand, gravity: float) -> None:
    moved = fall(free_hand(240, gravity=gravity), 0.5)
    np.testing.assert_allclose(moved, [0, 0, -gravity / 8], atol=0.01 * gravity + 1e-9)


@pytest.mark.parametrize("offset", [-0.02, 0.0, 0.02])
def test_a_force_accelerates_by_the_drawn_mass(free_hand, offset: float) -> None:
    world = free_hand(240, gravity=0.0, object_mass_offset=offset)
    world.disturb(np.array([0.04, 0.0, -0.02]), np.zeros(3))
    moved = fall(world, 0.5)
    np.testing.assert_allclose(moved, np.array([0.04, 0, -0.02]) / (0.05 + offset) / 8, rtol=0.02, atol=1e-9)
    world.disturb(np.zeros(3), np.zeros(3))
    speed = moved / 0.25
    np.testing.assert_allclose(fall(world, 0.5), 0.5 * speed, rtol=0.02, atol=1e-9)


def test_a_torque_turns_the_object(free_hand, things) -> None:
    world = free_hand(240, gravity=0.0)
    torque = np.array([0.0, 2e-5, 0.0])
    world.disturb(np.zeros(3), torque)
    start = world.rotation
    for _ in range(3):
        world.step(MEAN_GRASP)
    expected = 0.5 * 2e-5 / (0.05 * things["cube"].inertia[1, 1]) * 0.3**2
    np.testing.assert_allclose(world.rotation, exp(np.array([0, expected, 0])) @ start, atol=0.02 * expected)


def test_gravity_changes_the_compensation_too(free_hand) -> None:
    world = free_hand(60, gravity=0.0, stick_friction=np.zeros(12))
    world.set_gravity(9.81)
    assert fall(world, 0.5)[2] < -1.0
    np.testing.assert_allclose(world.joints[DRIVEN_INDEX], MEAN_GRASP, atol=1e-4)


def test_noise_is_added_to_the_angles_and_taken_from_the_errors(free_hand) -> None:
    noise = np.random.default_rng(0).normal(0, 0.02, (6, 12))
    plain, noisy = free_hand(60), free_hand(60)
    plain.step(MEAN_GRASP + 0.1)
    noisy.step(MEAN_GRASP + 0.1, noise)
    np.testing.assert_allclose(noisy.q - plain.q, noise, atol=1e-12)
    np.testing.assert_allclose(noisy.e - plain.e, -noise, atol=1e-12)
    np.testing.assert_array_equal(noisy.joints, plain.joints)


def test_an_encoder_offset_moves_the_joint_but_not_what_is_measured(free_hand) -> None:
    """The controller holds the measured angle, so the true one is off by the offset."""
    offset = np.linspace(-0.04, 0.04, 12)
    world = free_hand(60, touch=False, joint_offset=offset, stick_friction=np.zeros(12), gravity=0.0)
    for _ in range(15):
        world.step(MEAN_GRASP)
    np.testing.assert_allclose(world.joints[DRIVEN_INDEX], MEAN_GRASP - offset, atol=1e-3)
    np.testing.assert_allclose(world.q[-1], MEAN_GRASP, atol=1e-3)


def test_tips_hold_what_links_let_slip(make_world, bodies, physics) -> None:
    world = make_world()
    world.load(bodies[0], {**physics, "tip_friction": 0.85, "link_friction": 0.09, "spinning_friction": 1e-3})
    for finger in world.hand.fingers:
        for link in (1, 2, 3):  # the first has no geometry
            info = world.bullet.getDynamicsInfo(finger, link)
            tip = link == 3
            assert info[1] == pytest.approx(0.85 if tip else 0.09)
            assert info[7] == pytest.approx(1e-3 if tip else 0.0)
    assert world.bullet.getDynamicsInfo(world.object, -1)[1] == 1.0
