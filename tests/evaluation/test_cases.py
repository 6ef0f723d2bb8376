"""Which episodes an evaluation consists of."""

from __future__ import annotations

import numpy as np
import pytest

import randomization
from tactile_kit.evaluation import EvaluationError
from tactile_kit.evaluation.cases import Body, goal_rotation, make_cases, make_episodes
from tactile_kit.rotations import octahedral

NOMINAL = [Body("cube", 0, True), Body("apple", 0, True), Body("cylinder", 0, True)]
RANDOM = [
    Body("cube", 0, False),
    Body("apple", 0, False),
    Body("cube", 1, True),
    Body("apple", 1, True),
    Body("cube", 2, True),
]


def test_true_meshes_and_all_goals():
    cases = make_cases(NOMINAL, {"cube", "apple"})
    assert [(c.held, c.given) for c in cases] == [(0, 0), (1, 1)]
    assert all(c.goals == tuple(range(24)) for c in cases)


def test_fixed_median_mesh_is_the_same_object_at_nominal_size():
    cases = make_cases(RANDOM, {"cube", "apple"}, given="nominal")
    assert [(c.held, c.given) for c in cases] == [(2, 0), (3, 1), (4, 0)]


def test_confusion_has_every_pair_once():
    cases = make_cases(NOMINAL, {"cube", "apple", "cylinder"}, given="each")
    assert sorted((c.held, c.given) for c in cases) == [(i, j) for i in range(3) for j in range(3)]


def test_one_given_object_lends_its_mesh_only():
    cases = make_cases(NOMINAL, {"cube"}, given="apple")
    assert [(c.held, c.given) for c in cases] == [(0, 1)]


def test_episodes_are_distinct_and_shared_between_meshes():
    cases = make_cases(NOMINAL, {"cube", "apple"}, given="each", goals_per_case=5)
    episodes = make_episodes(NOMINAL, cases, 3, seed=7)
    assert len(episodes) == 4 * 5 * 3
    by_case = [{(e.goal, e.repeat, e.seed) for e in episodes if e.case == index} for index in range(4)]
    assert all(len(found) == 15 for found in by_case)
    assert by_case[0] == by_case[1] and by_case[2] == by_case[3]  # the same episodes under either mesh
    assert not {s for *_, s in by_case[0]} & {s for *_, s in by_case[2]}


def test_seeds_depend_on_name_and_seed_not_on_company():
    alone = make_episodes(NOMINAL, make_cases(NOMINAL, {"apple"}), 1, seed=0)
    cases = make_cases(NOMINAL, {"cube", "apple"})
    among = [e for e in make_episodes(NOMINAL, cases, 1, seed=0) if cases[e.case].held == 1]
    assert [e.seed for e in alone] == [e.seed for e in among]
    assert {e.seed for e in alone}.isdisjoint(
        e.seed for e in make_episodes(NOMINAL, make_cases(NOMINAL, {"apple"}), 1, seed=1)
    )


def test_evaluation_seeds_are_apart_from_trainings():
    seeds = {e.seed for e in make_episodes(NOMINAL, make_cases(NOMINAL, {"cube"}), 50, seed=0)}
    root = randomization.derive(0, "training")
    training = {
        int(randomization.stream(root, "episode", environment, number).integers(2**62))
        for environment in range(20)
        for number in range(50)
    }
    assert len(seeds) == 1200 and seeds.isdisjoint(training)


def test_goals_are_the_octahedral_group_or_on_so3():
    episode = make_episodes(NOMINAL, make_cases(NOMINAL, {"cube"}), 1, 0)[5]
    np.testing.assert_array_equal(goal_rotation(episode), octahedral()[5])
    free = make_episodes(NOMINAL, make_cases(NOMINAL, {"cube"}, goals="so3", goals_per_case=30), 1, 0)
    assert len({e.seed for e in free}) == 30 and {e.goal for e in free} == {-1}
    assert [e.repeat for e in free] == list(range(30))
    for e in free[:3]:
        rotation = goal_rotation(e)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    "names, settings",
    [
        ({"cube"}, {"given": "pear"}),
        ({"pear"}, {}),
        ({"cube"}, {"goals_per_case": 25}),
        ({"cube"}, {"goals": "cubic"}),
    ],
)
def test_what_does_not_exist_is_refused(names, settings):
    with pytest.raises(EvaluationError, match="allowed"):
        make_cases(NOMINAL, names, **settings)


def test_no_repeats_are_refused():
    with pytest.raises(EvaluationError, match="episodes_per_goal = 0"):
        make_episodes(NOMINAL, make_cases(NOMINAL, {"cube"}), 0, 0)
