"""The planner: its roll-outs are the simulator's own future, and following it turns the object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import randomization
from tactile_kit.planning import Planner, PlannerConfig
from tactile_kit.planning.gait import Move
from tactile_kit.rotations import exp, geodesic
from tactile_kit.simulation.episode import Status


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
    simulator.preset, simulator.horizon = randomization.preset("none"), 100
    simulator.reset(0, 3, 9.81)
    planner.start(0)
    plan, goal = (Move(lifted=(1,), back=0.3), Move(turn=0.05)), exp(np.array([0.0, 0.0, 1.0]))
    rollout = planner.play(simulator.world.snapshot(), plan, goal, np.zeros(small.horizon, bool))
    assert not rollout.failed
    moves = iter(plan)
    for _ in range(small.horizon):
        if planner.gait.over:
            planner.gait.start(next(moves, Move()))
        simulator.step(planner.gait.action(simulator.world, goal))
    for name in ("rotation", "position", "q", "e"):
        np.testing.assert_array_equal(getattr(planner.world, name), getattr(simulator.world, name))


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


def test_a_drop_ends_a_roll_out_and_costs(make, small) -> None:
    planner = make(small.model_copy(update={"drop": 7.0, "horizon": 30}))
    planner.simulator.reset(0, 3, 9.81)
    planner.start(0)
    moment = planner.simulator.world.snapshot()
    falling = replace(moment, velocity=np.array([0.0, 0.0, -3.0]))
    rollout = planner.play(falling, (Move(),), np.eye(3), np.zeros(30, bool))
    assert rollout.failed and -7.0 <= rollout.score < -5.5


def test_shaken_roll_outs_stick_as_often_as_the_episode(make, small) -> None:
    planner = make(small.model_copy(update={"horizon": 60}))
    simulator = planner.simulator
    simulator.reset(0, 3, 9.81)
    planner.start(0)
    assert 0.05 < np.mean([planner._sticky().mean() for _ in range(20)]) < 0.15  # the default's 0.1
    moment, goal, stuck = simulator.world.snapshot(), np.eye(3), np.ones(60, bool)
    resting = planner.play(moment, (Move(lifted=(1,)),), goal, stuck)
    assert not resting.failed  # no action arrives, and the grasp holds
    simulator.preset = randomization.preset("none")
    assert not planner._sticky().any()


def test_the_next_plan_is_what_was_left_of_the_last(make, small) -> None:
    planner = make(small)
    planner.simulator.reset(0, 3, 9.81)
    planner.start(0)
    planner.act(exp(np.array([0.0, 0.0, 1.5])))
    planner._next = (Move(turn=0.123),)
    assert planner._next in planner._plans(1.0)


@pytest.mark.slow
def test_planning_regrasps(make) -> None:
    """Turns that one grasp does not allow: half of it is done within five seconds, and nothing is dropped."""
    planner = make(PlannerConfig(plans=24))
    simulator = planner.simulator
    simulator.preset, simulator.horizon = randomization.preset("none"), 50
    gained = []
    for seed in range(3):
        simulator.reset(0, seed, 9.81)
        planner.start(seed)
        goal = exp(np.array([0.0, 0.0, 1.5])) @ simulator.world.rotation
        status = Status.RUNNING
        while status == Status.RUNNING:
            status = simulator.step(planner.act(goal))
        assert status == Status.TIME
        gained.append(1.5 - float(geodesic(simulator.world.rotation, goal)))
    assert np.median(gained) > 0.75
