"""The planner: its roll-outs are the simulator's own future, and following it turns the object."""

from __future__ import annotations

import numpy as np
import pytest

import randomization
from tactile_kit.planning import Planner, PlannerConfig
from tactile_kit.simulation.simulator import FULL_RANGE, MIDDLE, Status
from tactile_kit.task.rotations import exp, geodesic


@pytest.fixture
def make(core):
    made = []

    def build(config: PlannerConfig) -> Planner:
        made.append(Planner(core.blueprint.build(), config))
        return made[-1]

    yield build
    for planner in made:
        planner.close()
        planner.simulator.close()


def test_a_roll_out_is_what_then_happens(make, small) -> None:
    """From the start of an episode, where no contact is remembered yet, it is so to the bit."""
    planner = make(small)
    simulator = planner.simulator
    simulator.preset = randomization.preset("none")
    simulator.reset(0, 3, 9.81)
    planner.start(0)
    held = (simulator.world.command - MIDDLE) / FULL_RANGE
    sequence = np.clip(held + np.random.default_rng(0).normal(0, 0.1, (5, 12)), -1, 1)
    rollout = planner.roll_out(simulator.world.snapshot(), sequence, np.eye(3))
    assert len(rollout.states) == 6 and not rollout.failed
    for action, state in zip(sequence, rollout.states[1:], strict=True):
        simulator.step(action)
        np.testing.assert_array_equal(state.R, simulator.world.rotation)
        np.testing.assert_array_equal(state.x, simulator.world.position)
        window = np.stack([simulator.world.q, simulator.world.e], axis=1).astype(np.float32)
        np.testing.assert_array_equal(state.z, window.ravel())


def test_planning_leaves_the_episode_alone(make, small) -> None:
    planner = make(small)
    simulator = planner.simulator
    simulator.reset(0, 3, 9.81)
    planner.start(0)
    before = simulator.world.snapshot()
    planner.act(np.eye(3))
    for name, value in vars(before).items():
        np.testing.assert_array_equal(value, getattr(simulator.world.snapshot(), name))


def test_the_same_seed_plans_the_same(make, small) -> None:
    actions = []
    for _ in range(2):
        planner = make(small)
        planner.simulator.reset(0, 3, 9.81)
        planner.start(7)
        actions.append(planner.act(np.eye(3)))
    np.testing.assert_array_equal(*actions)


def test_few_fingers_move_few_fingers(make) -> None:
    planner = make(PlannerConfig(samples=60, few_fingers=1.0))
    planner.simulator.reset(0, 3, 9.81)
    planner.start(0)
    changed = np.abs(planner._candidates() - planner.best).reshape(60, -1, 4, 3).max((1, 3)) > 0
    assert not changed[0].any()
    assert set(changed[1:].sum(1).tolist()) == {1, 2}


def test_a_drop_ends_a_roll_out_and_costs(make, small) -> None:
    planner = make(small.model_copy(update={"drop": 7.0}))
    planner.simulator.reset(0, 3, 9.81)
    planner.start(0)
    away = np.tile((np.tile([0.0, -0.34, 0.0], 4) - MIDDLE) / FULL_RANGE, (30, 1))
    rollout = planner.roll_out(planner.simulator.world.snapshot(), away, np.eye(3))
    assert rollout.failed and len(rollout.actions) < 30 and rollout.score < -6.5


def test_planning_turns_the_object(make) -> None:
    """A turn that one grasp allows: most of it is done within two seconds."""
    planner = make(PlannerConfig(samples=16))
    simulator = planner.simulator
    simulator.horizon = 20
    gained = []
    for seed in range(3):
        simulator.reset(0, seed, 9.81)
        planner.start(seed)
        goal = exp(np.array([0.0, 0.0, 0.5])) @ simulator.world.rotation
        status = Status.RUNNING
        while status == Status.RUNNING:
            status = simulator.step(planner.act(goal))
        gained.append(0.5 - float(geodesic(simulator.world.rotation, goal)))
    assert np.median(gained) > 0.15
