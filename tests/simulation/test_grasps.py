"""Grasps: found, held, refused with an error that says what was tried."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_kit.hand import kinematics
from tactile_kit.rotations import geodesic
from tactile_kit.simulation import grasps
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.grasps import GraspBank, GraspError, find_grasps


def test_every_grasp_of_the_bank_holds_for_a_second(bank, bodies, make_world, physics) -> None:
    world = make_world()
    for index, body in enumerate(bodies):
        for number in range(bank.count(index)):
            grasp = bank.grasp(index, number)
            world.load(body, physics)
            world.place(grasp)
            for _ in range(10):
                world.step(grasp.command)
            assert np.linalg.norm(world.position - grasp.position) < 5e-3
            assert geodesic(world.rotation, grasp.rotation) < 0.15
            touching = {contact[1] for contact in world.hand.contacts(world.object)}
            assert len(touching) >= 3  # fingers at the object


def test_grasps_are_within_limits_and_differ(bank) -> None:
    assert len(bank) == 2 and [bank.count(0), bank.count(1)] == [2, 2]
    driven = bank.joints[:, kinematics.DRIVEN_INDEX]
    assert (driven > kinematics.JOINT_LOWER - 0.02).all() and (driven < kinematics.JOINT_UPPER + 0.02).all()
    assert geodesic(bank.rotation[0], bank.rotation[1]) > 0.05
    with pytest.raises(IndexError, match="0 to 1"):
        bank.grasp(1, 2)


def test_the_search_repeats_itself(things, bank, make_world) -> None:
    """Also after the world has been used for something else."""
    world = make_world()
    find_grasps(world, things["l_shape"], 1, seed=3)
    first, second = find_grasps(world, things["cube"], 2)
    for number, grasp in enumerate((first, second)):
        np.testing.assert_array_equal(grasp.joints, bank.grasp(0, number).joints)
        np.testing.assert_array_equal(grasp.position, bank.grasp(0, number).position)


def test_what_can_not_be_held_is_an_error(things, make_world) -> None:
    thing = things["cube"].with_extents([0.002, 0.002, 0.002])
    with pytest.raises(GraspError, match=r"cube with extents \[2. 2. 2.\] mm: 0 of 1 .* 3 tries"):
        find_grasps(make_world(), thing, 1, attempts=3)


def test_an_object_inside_the_open_hand_is_no_grasp(things, make_world) -> None:
    assert grasps.try_grasp(make_world(), Body(things["cube"].with_extents([0.3] * 3)), np.eye(3)) is None


def test_banks_join_in_order(bank) -> None:
    one = GraspBank(bank.joints[:2], bank.command[:2], bank.position[:2], bank.rotation[:2], np.array([0, 2]))
    joined = GraspBank.joined([bank, one])
    assert [joined.count(index) for index in range(3)] == [2, 2, 2]
    np.testing.assert_array_equal(joined.grasp(2, 1).joints, bank.grasp(0, 1).joints)
    np.testing.assert_array_equal(joined.grasp(1, 0).command, bank.grasp(1, 0).command)
