"""Turns that leave objects as they are, found on meshes of which geometry says what they must be."""

from __future__ import annotations

import numpy as np
import pytest

import object_sets
import randomization
from tactile_kit.evaluation.symmetry import symmetry_of
from tactile_kit.rotations import exp, geodesic, octahedral, random_rotations

THINGS = {thing.name: thing for thing in object_sets.load("all")}
TURNS = {
    "cube": 24, "rhombicuboctahedron": 24, "cuboid": 8, "plus_prism": 8, "cut_cube": 3, "t_shape": 2, "l_shape": 2,
    "elephant": 1,
}  # fmt: skip


@pytest.mark.parametrize("name", TURNS)
def test_turns_are_those_of_the_shape(name):
    symmetry = symmetry_of(THINGS[name])
    assert len(symmetry.rotations) == TURNS[name] and not len(symmetry.axes)
    assert symmetry.trivial == (TURNS[name] == 1)


def test_another_size_has_another_symmetry():
    assert len(symmetry_of(THINGS["cube"].with_extents(np.array([0.06, 0.06, 0.08]))).rotations) == 8
    assert len(symmetry_of(THINGS["cube"].with_extents(np.array([0.06, 0.07, 0.08]))).rotations) == 4
    hexagon = THINGS["hexagonal_prism"].with_extents(np.array([0.06 * 3**0.5 / 2, 0.06, 0.05]))
    assert len(symmetry_of(hexagon).rotations) == 12


def test_turns_are_a_group():
    turns = symmetry_of(THINGS["cube"]).rotations
    for first in turns:
        for second in turns:
            assert geodesic(turns, first @ second).min() < 1e-6


def test_a_cube_turned_by_a_right_angle_is_where_it_was_and_never_further_off_than_62_degrees():
    symmetry = symmetry_of(THINGS["cube"])
    rng = randomization.stream(0, "test", "symmetry")
    true, believed = random_rotations(rng, 500), random_rotations(rng, 500)
    np.testing.assert_allclose(symmetry.error(true @ octahedral()[7], true), 0.0, atol=1e-6)
    errors = symmetry.error(believed, true)
    assert errors.max() < np.radians(62.8) and (errors <= geodesic(believed, true) + 1e-9).all()
    small = exp(np.array([0.1, -0.2, 0.05]))
    np.testing.assert_allclose(
        symmetry.error(true @ small, true), np.linalg.norm([0.1, -0.2, 0.05]), atol=1e-6
    )


def test_of_a_cylinder_only_the_tilt_of_its_axis_counts():
    symmetry = symmetry_of(THINGS["cylinder"])
    np.testing.assert_array_equal(symmetry.axes, [[0.0, 0.0, 1.0]])
    rng = randomization.stream(0, "test", "cylinder")
    true, believed = random_rotations(rng, 200), random_rotations(rng, 200)
    axes = np.abs(np.sum(true[:, :, 2] * believed[:, :, 2], axis=1))
    np.testing.assert_allclose(symmetry.error(believed, true), np.arccos(np.clip(axes, 0, 1)), atol=1e-6)


def test_an_object_without_symmetry_has_the_papers_error():
    symmetry = symmetry_of(THINGS["elephant"])
    rng = randomization.stream(0, "test", "elephant")
    true, believed = random_rotations(rng, 100), random_rotations(rng, 100)
    np.testing.assert_allclose(symmetry.error(believed, true), geodesic(believed, true), atol=1e-9)
