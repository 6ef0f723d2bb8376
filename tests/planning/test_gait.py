"""Moves: what they lift, where they turn, when they end."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import randomization
from tactile_kit.hand.kinematics import DRIVEN_INDEX
from tactile_kit.planning import laws
from tactile_kit.planning.gait import LIFTS, Gait, Gaits, Move, random_move
from tactile_kit.planning.planner import angle_between
from tactile_kit.rotations import exp
from tactile_kit.simulation.episode import FULL_RANGE, MIDDLE
from tactile_kit.simulation.simulator import Simulator


@pytest.fixture
def held(core) -> Simulator:
    simulator = core.blueprint.build()
    simulator.preset, simulator.horizon = randomization.preset("none"), 100
    simulator.reset(0, 3, 9.81)
    yield simulator
    simulator.close()


@pytest.fixture
def gait(held) -> Gait:
    return Gait(held.world.config.filter_time_constant)


def carry_out(gait: Gait, held: Simulator, move: Move, goal: np.ndarray) -> list[set[int]]:
    """Fingers that touch the object after each control step of ``move``."""
    touching, world = [], held.world
    gait.start(move)
    while not gait.over:
        held.step(gait.action(world, goal))
        points = [point for point in world.hand.contacts(world.object) if point[9] > 0]  # normal force
        touching.append({world.hand.fingers.index(point[1]) for point in points})
    return touching


def test_resting_keeps_the_command(gait, held) -> None:
    gait.start(Move(rest=True, steps=3))
    before = held.world.command.copy()
    action = gait.action(held.world, np.eye(3))
    np.testing.assert_allclose(MIDDLE + FULL_RANGE * action, before, atol=1e-12)


def test_turning_turns_towards_the_goal(gait, held) -> None:
    goal = exp(np.array([0.0, 0.0, 0.5])) @ held.world.rotation
    before = angle_between(held.world.rotation, goal)
    carry_out(gait, held, Move(turn=0.1, steps=10), goal)
    assert angle_between(held.world.rotation, goal) < before - 0.1


@pytest.mark.parametrize("lifted", [(1,), (3,), (1, 3)])
def test_lifted_fingers_let_go_and_come_back_while_the_others_hold(gait, held, lifted) -> None:
    touching = carry_out(gait, held, Move(lifted=lifted, steps=5), held.world.rotation)
    assert all(any(finger not in touch for touch in touching) for finger in lifted)
    assert 5 <= len(touching) <= 2 * 2 + 6 + 1
    assert np.linalg.norm(held.world.position) < 0.05


def test_gaits_side_by_side_do_what_each_does_alone(held) -> None:
    generator = np.random.default_rng(1)
    moves = [random_move(generator) for _ in range(6)]
    time_constant, world = held.world.config.filter_time_constant, held.world
    together = Gaits(len(moves), time_constant)
    together.begin(np.arange(len(moves)), moves)
    alone = [Gait(time_constant) for _ in moves]
    for gait, move in zip(alone, moves, strict=True):
        gait.start(move)
    goal = exp(np.array([0.3, 0.0, 0.5])) @ world.rotation
    for _ in range(12):
        wanted = np.stack([gait.action(world, goal) for gait in alone])
        many = [np.repeat(value[None], len(moves), axis=0) for value in (
            world.joints[DRIVEN_INDEX], world.command, world.position, world.rotation, goal,
        )]  # fmt: skip
        np.testing.assert_array_equal(together.actions(*many), wanted)
        np.testing.assert_array_equal(together.done, [gait.over for gait in alone])
        held.step(wanted[0])


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(1e-6, np.pi))
def test_compiled_rotations_are_the_rotations(seed: int, angle: float) -> None:
    axis = np.random.default_rng(seed).normal(size=3)
    axis /= np.linalg.norm(axis)
    turn = laws.rotation_about(axis, angle)
    np.testing.assert_allclose(turn, exp(axis * angle), atol=1e-12)
    np.testing.assert_allclose(exp(laws.rotation_vector(turn)), turn, atol=1e-9)


def test_random_moves_differ_and_stay_in_range() -> None:
    generator = np.random.default_rng(0)
    moves = [random_move(generator) for _ in range(300)]
    assert {move.lifted for move in moves} == {(), *LIFTS}
    assert all(0.006 <= move.squeeze <= 0.018 and 0 <= move.back <= 0.8 for move in moves)
    assert 0.6 < np.mean([bool(move.lifted) for move in moves]) < 0.9
