"""Bodies of a task and who plays which."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest

from object_sets import UnknownObjectError
from tactile_kit.rotations import geodesic, octahedral
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.goals import training_episodes
from tactile_kit.task.variants import prepare


def test_nominal_sizes(variants) -> None:
    assert [thing.name for thing in variants.objects] == ["cube", "l_shape"] and len(variants) == 2
    assert variants.number_of_objects == 2 and variants.playable.all()
    assert [variants.bank.count(i) for i in range(2)] == [2, 2]


def test_random_sizes_lie_in_the_range_and_repeat() -> None:
    config = TaskConfig(objects="cube", scaling="random", variants=2, grasps=1, extent_range=(0.06, 0.075))
    one, two = prepare(config), prepare(config)
    assert len(one) == 3 and one.playable.tolist() == [False, True, True]
    np.testing.assert_array_equal(one.of_object(0), [1, 2])
    assert [one.nominal(i) for i in range(3)] == [0, 0, 0]
    for thing, again in zip(one.objects[1:], two.objects[1:], strict=True):
        assert ((thing.extents >= 0.06) & (thing.extents <= 0.075)).all()
        assert thing.digest == again.digest
        assert np.ptp(thing.extents) > 1e-4  # every axis for itself
    assert one.objects[1].digest != one.objects[2].digest


def test_unknown_objects_are_named() -> None:
    with pytest.raises(UnknownObjectError, match="cube"):
        prepare(TaskConfig(objects="cubee"))


@pytest.mark.parametrize("environments", [1, 2, 3, 4])
def test_no_object_is_left_out_whatever_the_number_of_environments(task, variants, environments: int) -> None:
    played: Counter = Counter()
    for environment in range(environments):
        specs = itertools.islice(training_episodes(task, variants, environment, 0, environments), 12)
        own = [spec.variant for spec in specs]
        if environments % 2 == 0:
            assert len(set(own)) == 1  # one object an environment
        played.update(own)
    assert played[0] == played[1] == 6 * environments


def test_training_episodes_are_the_seeds(task, variants) -> None:
    def first(environment: int, seed: int) -> list:
        specs = itertools.islice(training_episodes(task, variants, environment, seed, 4), 3)
        return [(spec.seed, spec.goal.tolist()) for spec in specs]

    assert first(0, 1) == first(0, 1)
    assert first(0, 1) != first(0, 2) and first(0, 1) != first(2, 1)
    assert len({seed for seed, _ in first(0, 1)}) == 3


def test_octahedral_goals_are_the_groups(variants) -> None:
    config = TaskConfig(objects="cube,l_shape", grasps=2, goals="octahedral")
    for spec in itertools.islice(training_episodes(config, variants, 0, 0), 30):
        assert geodesic(octahedral(), spec.goal).min() == 0
        assert spec.given == spec.variant
