"""Every failure is of exactly one kind."""

from __future__ import annotations

import itertools

import pytest

from tactile_kit.errors import EvaluationError
from tactile_kit.evaluation.failures import KINDS, kind_of


def test_kinds_are_a_partition_of_all_failures():
    angles = (0.0, 0.39, 0.4, 1.0, 3.0)
    seen = set()
    for end, theta, error in itertools.product(("time", "drop", "fault"), angles, angles):
        for symmetric in (angle for angle in angles if angle <= error):
            kind = kind_of(end, theta, error, symmetric)
            assert (kind is None) == (end == "time" and theta < 0.4)
            assert kind is None or kind in KINDS
            seen.add(kind)
    assert seen == {None, *KINDS}


@pytest.mark.parametrize(
    "case, kind",
    [
        (("drop", 0.1, 0.0, 0.0), "drop"),
        (("fault", 0.1, 0.0, 0.0), "drop"),
        (("time", 0.5, 0.1, 0.1), "stall"),
        (("time", 0.5, 0.4, 0.4), "lost"),
        (("time", 1.6, 1.57, 0.1), "symmetry"),
        (("time", 0.5, 0.1, None), "stall"),
    ],
)
def test_what_is_which(case, kind):
    assert kind_of(*case) == kind


def test_what_can_not_be_told_is_refused():
    with pytest.raises(EvaluationError, match="end = ''"):
        kind_of("", 1.0, 1.0, 1.0)
    with pytest.raises(EvaluationError, match="symmetric = None"):
        kind_of("time", 1.0, 1.0, None)
