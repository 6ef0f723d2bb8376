"""Episodes as they are shown are those that evaluations play."""

import numpy as np
import pytest

from object_sets import UnknownObjectError
from tactile_kit.errors import ViewError
from tactile_kit.rotations import geodesic, octahedral
from tactile_kit.view.choice import Choice
from tactile_kit.view.episode import Episode, goal_names
from tactile_kit.view.frames import Clip


def test_frames_are_what_the_environment_says(oracle):
    choice = Choice("cube", goal=9, seed=3)
    task = choice.task(oracle.task)
    variants = choice.variants(task)
    episode = Episode.of(oracle, choice)
    env = oracle.make_env(task, 1, 0, 0, [choice.spec()], variants)
    try:
        observation = env.reset()
        while env.results[0] is None:
            observation, *_ = env.step(oracle.act(observation))
            frame = episode.step()
            assert np.array_equal(frame.truth.position, env.transition.x[0])
            assert np.array_equal(frame.truth.rotation, env.transition.R[0])
        assert episode.done and episode.clip.outcome.theta == env.results[0].theta
        assert episode.clip.angles[-1] == pytest.approx(env.results[0].theta)
        assert episode.clip.errors is None  # the truth is told: nothing is estimated
    finally:
        env.close()
        episode.close()


def test_an_episode_has_estimates_contacts_and_an_end(clip: Clip):
    assert clip.held.name == "cube" and clip.given.name == "cuboid" and clip.outcome is not None
    assert clip.times == pytest.approx(0.1 * np.arange(len(clip.frames)))
    start, later = clip.frames[0], clip.frames[10]
    assert clip.errors[0] == pytest.approx(0, abs=1e-3)  # the start is given
    assert clip.errors[10] == pytest.approx(geodesic(later.estimate.rotation, later.truth.rotation))
    assert later.sigma.shape == (2,) and not len(start.contacts.points)
    touched = np.linalg.norm(later.contacts.points - later.truth.position, axis=1)
    assert len(touched) >= 2 and touched.max() < np.linalg.norm(clip.held.extents) / 2 + 0.005
    if not clip.outcome.drop:
        assert len(clip.frames[-1].contacts.points) >= 2  # the end's are not those of the next start


def test_a_push_moves_the_object_and_is_told(oracle):
    choice = Choice("cube", goal=9, seed=3, preset="none")
    ways = []
    for force in (0.0, 2.0):
        episode = Episode.of(oracle, choice)
        try:
            if force:
                episode.push(np.array([0.0, force, 0.0]))
            frame = episode.step()
            assert frame.pushed == bool(force)
            ways.append(frame.truth.position)
            assert not episode.step().pushed
        finally:
            episode.close()
    assert np.linalg.norm(ways[1] - ways[0]) > 5e-4


def test_choices_reach_the_episode(oracle):
    choice = Choice("cube", extents=(6.0, 6.5, 7.0), terms={"kp": 5.0, "force": "none"}, goal=4)
    episode = Episode.of(oracle, choice)
    try:
        assert episode.clip.held.extents == pytest.approx([0.06, 0.065, 0.07])
        assert np.array_equal(episode.clip.goal, octahedral()[4])
        assert episode._env.simulation.simulators[0].physics["kp"] == 5.0
    finally:
        episode.close()
    terms = choice.physics().terms
    assert not any(terms["force"].distribution.support()) and any(terms["torque"].distribution.support())


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"goal": 24}, "goal = 24; allowed are 0 to 23"),
        ({"extents": (3.0, 6.0, 6.0)}, "4.5 to 9 cm"),
        ({"terms": {"tip": 1.0}}, "'tip'; allowed are joint_offset"),
        ({"terms": {"kp": "hard"}}, "kp = 'hard'; allowed are a number and none"),
        ({"terms": {"tip_friction": 99.0}}, "tip_friction reaches from 99"),
        ({"preset": "defualt"}, "'default'"),
        ({"held": "geometric8"}, "'geometric8' is 8 objects"),
    ],
)
def test_what_can_not_be_shown_is_named(wrong: dict, text: str, oracle):
    with pytest.raises(ValueError, match=text):
        choice = Choice(**wrong)
        choice.physics()
        choice.variants(choice.task(oracle.task))


def test_unknown_objects_are_named(oracle):
    with pytest.raises(UnknownObjectError, match="nearest valid name: 'cube'"):
        Episode.of(oracle, Choice("cubee"))


def test_goals_have_names_of_their_own():
    names = goal_names()
    assert len(set(names)) == 24 and names[0] == "0: as it lies" and names[10] == "10: 90° about z"


def test_errors_are_value_errors():
    assert issubclass(ViewError, ValueError)
