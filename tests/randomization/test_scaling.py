"""One term wider or narrower: spread about the centre, the same draws, the others untouched."""

from __future__ import annotations

import numpy as np
import pytest

import randomization
from randomization import (
    Bernoulli,
    Direction,
    LogUniform,
    Normal,
    RandomizationError,
    Uniform,
    preset,
    read_randomization,
    scaled,
)

DEFAULT = preset("default")


@pytest.mark.parametrize(
    "name, expected",
    [
        ("joint_offset", Uniform(-0.08, 0.08)),
        ("series_stiffness", Uniform(5, 45)),
        ("stick_friction", Uniform((0.0, 0.0, 0.0), (0.04, 0.04, 0.12))),
        ("joint_noise", Normal(0, 0.04)),
        ("sticky_action", Bernoulli(0.2)),
        ("force", Direction(0.08)),
    ],
)
def test_twice_as_wide(name, expected):
    found = scaled(DEFAULT, [name], 2).terms[name].distribution
    assert type(found) is type(expected)
    for field, value in vars(expected).items():
        np.testing.assert_allclose(getattr(found, field), value, atol=1e-12)


def test_none_of_it_is_the_centre_and_the_others_draw_as_before():
    still = scaled(
        DEFAULT, ["tip_friction", "joint_noise", "sticky_action", "torque", "spinning_friction"], 0
    )
    here, there = DEFAULT.draw("episode", 5), still.draw("episode", 5)
    assert there["tip_friction"] == pytest.approx(0.9)
    assert there["spinning_friction"] == pytest.approx(np.sqrt(2e-4 * 2e-2))
    np.testing.assert_array_equal(here["joint_offset"], there["joint_offset"])
    steps = still.draw_steps(5, 50)
    assert not steps["sticky_action"].any() and not steps["joint_noise"].any()
    assert not still.draw_intervals(5, 10.0)["torque"].any()


def test_a_wider_term_draws_the_same_numbers_further_apart():
    one, two = (scaled(DEFAULT, ["joint_offset"], factor).draw("episode", 3) for factor in (1, 2))
    np.testing.assert_allclose(two["joint_offset"], 2 * one["joint_offset"])
    assert isinstance(
        scaled(DEFAULT, ["spinning_friction"], 0.5).terms["spinning_friction"].distribution, LogUniform
    )


def test_it_is_written_and_read_back(tmp_path):
    wide = scaled(DEFAULT, ["joint_offset", "force"], 2)
    randomization.write_randomization(wide, tmp_path / "wide.yaml")
    assert read_randomization(tmp_path / "wide.yaml") == wide


@pytest.mark.parametrize(
    "names, factor, said",
    [
        (["joint_offsets"], 1, "joint_offset"),
        (["joint_offset"], -1, "factor = -1"),
        (["joint_offset"], float("nan"), "factor"),
        (["spinning_friction"], 2, "spinning_friction reaches from"),
    ],
)
def test_what_is_wrong_is_said(names, factor, said):
    with pytest.raises(RandomizationError, match=said):
        scaled(DEFAULT, names, factor)
