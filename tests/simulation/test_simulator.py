"""Episodes: their end by time, drop and fault, their disturbances, sticky actions."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import randomization
from randomization import Bernoulli, Constant
from tactile_kit.hand import kinematics
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.episode import FULL_RANGE, MIDDLE, Status, dropped
from tactile_kit.simulation.simulator import Simulator


def with_terms(**distributions) -> randomization.Randomization:
    """Preset none with some terms exchanged."""
    terms = dict(randomization.preset("none").terms)
    for name, distribution in distributions.items():
        terms[name] = dataclasses.replace(terms[name], distribution=distribution)
    return randomization.Randomization("changed", terms.values())


@pytest.fixture
def build(bodies, bank):
    made = []

    def make(preset=None, horizon: int = 10) -> Simulator:
        preset = preset or randomization.preset("none")
        made.append(Simulator(SimulationConfig(), bodies, bank, preset, horizon))
        made[-1].reset(0, 5, 9.81)
        return made[-1]

    yield make
    for one in made:
        one.close()


def hold(simulator: Simulator) -> np.ndarray:
    return (simulator.world.command - MIDDLE) / FULL_RANGE


def finite_state(simulator: Simulator) -> bool:
    z, x, R, q = np.zeros(144, np.float32), np.zeros(3), np.zeros((3, 3)), np.zeros(12)
    simulator.read(z, x, R, q)
    return all(np.isfinite(array).all() for array in (z, x, R, q)) and np.allclose(R @ R.T, np.eye(3))


def test_time_ends_an_episode_at_the_horizon(build) -> None:
    simulator = build()
    action = hold(simulator)
    statuses = [simulator.step(action) for _ in range(10)]
    assert statuses == [Status.RUNNING] * 9 + [Status.TIME]
    assert simulator.elapsed == 10 and simulator.fault is None


def test_an_open_hand_drops_the_object(build) -> None:
    simulator = build(horizon=100)
    while (status := simulator.step(-np.ones(12))) == Status.RUNNING:
        pass
    assert status == Status.DROP and 2 <= simulator.elapsed < 15
    assert simulator.world.position[2] < -0.05


def test_a_drop_in_the_last_step_is_no_end_by_time(build) -> None:
    simulator = build(horizon=100)
    while simulator.step(-np.ones(12)) == Status.RUNNING:
        pass
    simulator.horizon = simulator.elapsed
    simulator.reset(0, 5, 9.81)
    statuses = [simulator.step(-np.ones(12)) for _ in range(simulator.horizon)]
    assert statuses[-1] == Status.DROP


def test_where_the_drop_begins() -> None:
    places = np.array(
        [[0, 0, -0.049], [0, 0, -0.051], [0.099, 0, 0], [0.101, 0, 0], [-0.101, 0, 0], [0, 0, 0.09]]
    )
    np.testing.assert_array_equal(dropped(places), [False, True, False, True, True, False])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_action_that_is_no_number_is_a_fault(build, bad: float) -> None:
    simulator = build()
    simulator.step(hold(simulator))
    action = hold(simulator)
    action[7] = bad
    assert simulator.step(action) == Status.FAULT
    assert "not finite" in simulator.fault and simulator.elapsed == 2
    assert finite_state(simulator)


def test_physics_that_is_no_number_is_a_fault_and_ends_with_the_episode(build) -> None:
    simulator = build()
    action = hold(simulator)
    courses = []
    for fault in (False, True, False):
        simulator.reset(0, 5, 9.81)
        simulator.step(action)
        if fault:
            before = simulator.world.position.copy()
            simulator.world.bullet.resetBaseVelocity(simulator.world.object, [np.nan] * 3, [0, 0, 0])
            assert simulator.step(action) == Status.FAULT
            assert "nan" in simulator.fault
            assert finite_state(simulator)
            np.testing.assert_array_equal(simulator.world.position, before)
        else:
            assert simulator.step(action) == Status.RUNNING and simulator.fault is None
            courses.append(simulator.world.position.copy())
    np.testing.assert_array_equal(*courses)


def test_actions_span_the_joint_range_and_are_clipped_to_it(build) -> None:
    simulator = build(horizon=100)
    for _ in range(25):
        simulator.step(np.full(12, 7.0))
    np.testing.assert_allclose(simulator.world.command, kinematics.JOINT_UPPER, atol=1e-3)
    for _ in range(25):
        simulator.step(-np.ones(12))
    np.testing.assert_allclose(simulator.world.command, kinematics.JOINT_LOWER, atol=1e-3)


def test_sticky_actions_repeat_the_last_target(build) -> None:
    always, never = (
        build(with_terms(sticky_action=Bernoulli(1.0))),
        build(with_terms(sticky_action=Bernoulli(0.0))),
    )
    start = always.world.command.copy()
    for simulator in (always, never):
        simulator.step(hold(simulator) + 0.2)
    np.testing.assert_array_equal(always.world.command, start)
    assert (never.world.command > start + 0.01).all()


def test_disturbances_change_the_course(build) -> None:
    calm, pushed = build(), build(with_terms(force=Constant((0.0, 0.0, -1.0))))
    turned = build(with_terms(torque=Constant((0.0, 0.0, 5e-3))))
    action = hold(calm)
    for simulator in (calm, pushed, turned):
        simulator.step(action)
    assert pushed.world.position[2] < calm.world.position[2] - 1e-5
    assert np.abs(turned.world.rotation - calm.world.rotation).max() > 1e-5


def test_disturbances_are_redrawn_every_half_second(build) -> None:
    simulator = build(randomization.preset("default"), horizon=20)
    rows: list[tuple] = []
    world = simulator.world
    world.disturb = lambda force, torque: rows.append((simulator.elapsed - 1, *force, *torque))  # type: ignore[method-assign]
    for _ in range(20):
        simulator.step(hold(simulator))
    when, felt = np.array(rows)[:, 0], np.array(rows)[:, 1:]
    np.testing.assert_array_equal(when, [0, 5, 10, 15])  # said once, as it stays until the next
    np.testing.assert_allclose(np.linalg.norm(felt[:, :3], axis=1), 0.04)
    np.testing.assert_allclose(np.linalg.norm(felt[:, 3:], axis=1), 2e-3)
    assert (np.abs(np.diff(felt, axis=0)).max(1) > 0).all()


def test_the_curriculums_gravity_is_used_and_recorded(build) -> None:
    simulator = build(randomization.preset("default"))
    for gravity in (0.981, 9.81):
        simulator.reset(0, 5, gravity)
        assert simulator.physics["gravity"] == gravity
        assert simulator.world.physics["gravity"] == gravity
    heights = []
    for gravity in (0.0, 9.81):
        simulator.reset(0, 5, gravity)
        for _ in range(6):
            simulator.step(-np.ones(12))
        heights.append(simulator.world.position[2])
    assert heights[0] > heights[1] + 0.05


def test_physics_and_grasp_are_the_seeds(build) -> None:
    simulator = build(randomization.preset("default"))
    drawn = []
    for seed in (1, 2, 1):
        simulator.reset(1, seed, 9.81)
        drawn.append(
            (
                simulator.physics["kp"],
                simulator.physics["joint_offset"].tolist(),
                simulator.initial_position.tolist(),
            )
        )
    assert drawn[0] == drawn[2] and drawn[0] != drawn[1]
    starts = set()
    for seed in range(12):
        simulator.reset(1, seed, 9.81)
        starts.add(simulator.initial_position.tobytes())
    assert len(starts) == 2  # both grasps of the bank
