"""Rates, angles and changes of rows whose answers are known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_kit.evaluation import (
    EpisodeRow,
    EvaluationError,
    final_angles,
    mean_final_angle,
    relative_change,
    success_rate,
)
from tactile_kit.evaluation.intervals import wilson

BASE = EpisodeRow(
    "a", "tactile", "bps", 0, 8, "cube", 0, 0.0675, 0.0675, 0.0675, 8, "cube", 0.0675, 0.0675, 0.0675, 0, 0, 0,
    0.2, 0.1, True, False, "", 100,
)  # fmt: skip


def rows(successes: int, total: int, item: int = 8, good: float = 0.2, bad: float = 1.2) -> list[EpisodeRow]:
    return [
        dataclasses.replace(
            BASE, object_id=item, episode=i, success=i < successes, theta=good if i < successes else bad
        )
        for i in range(total)
    ]


def test_success_rate_is_the_count_with_wilsons_interval():
    found = success_rate(rows(30, 40))
    assert (found.value, found.n, found.successes) == (0.75, 40, 30)
    assert (found.low, found.high) == wilson(30, 40)


def test_drops_and_faults_are_failures():
    dropped = dataclasses.replace(BASE, success=False, drop=True)
    fault = dataclasses.replace(BASE, success=False, fault="nan", theta=None, theta_min=None)
    found = success_rate([BASE, dropped, fault])
    assert found.value == pytest.approx(1 / 3)
    np.testing.assert_array_equal(final_angles([BASE, dropped, fault]), [0.2, 0.2])


def test_mean_angle_lies_in_its_interval():
    found = mean_final_angle(rows(10, 40) + rows(30, 40, item=5))
    assert found.value == pytest.approx(0.7) and found.n == 80
    assert found.low < 0.7 < found.high


def test_relative_change_is_the_ratio_less_one():
    change = relative_change(rows(20, 40), rows(30, 40), "success")
    assert change.value == pytest.approx(20 / 30 - 1) and change.low < change.value < change.high
    angle = relative_change(rows(20, 40), rows(30, 40), "angle")
    assert angle.value == pytest.approx(0.7 / 0.45 - 1)


def test_no_change_is_exactly_none():
    assert relative_change(rows(20, 40), rows(20, 40), "success").value == 0.0


def test_no_ratio_to_nothing():
    assert relative_change(rows(3, 40), rows(0, 40), "success") is None


def test_one_episode_an_object_has_no_interval():
    change = relative_change(rows(1, 1), rows(1, 1), "success")
    assert change.value == 0.0 and change.low is None and change.high is None


def test_nothing_is_refused():
    with pytest.raises(EvaluationError, match="at least one"):
        success_rate([])
    with pytest.raises(EvaluationError, match="allowed"):
        relative_change(rows(1, 2), rows(1, 2), "speed")
