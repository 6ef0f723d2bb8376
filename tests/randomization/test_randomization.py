"""Presets, drawing, replay and the gravity schedule."""

import json
import pickle
import time
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from randomization import PRESETS, GravitySchedule, Normal, Randomization, RandomizationError, Term, preset

EPISODE = {
    "joint_offset": 12,
    "kp": 1,
    "kd": 1,
    "series_stiffness": 1,
    "stick_friction": 12,
    "tip_friction": 1,
    "link_friction": 1,
    "spinning_friction": 1,
    "object_mass_offset": 1,
    "gravity": 1,
}
each_preset = pytest.mark.parametrize("name", PRESETS)


def same(first: dict, second: dict) -> bool:
    return first.keys() == second.keys() and all(np.array_equal(first[key], second[key]) for key in first)


@each_preset
def test_names_sizes_and_types_are_the_contract(name):
    randomization = preset(name)
    values = randomization.draw("episode", 0)
    assert {key: np.size(value) for key, value in values.items()} == EPISODE
    assert all(isinstance(value, float if EPISODE[key] == 1 else np.ndarray) for key, value in values.items())
    steps, intervals = randomization.draw_steps(0, 100), randomization.draw_intervals(0, 10.0)
    assert {key: (value.shape, value.dtype) for key, value in steps.items()} == {
        "joint_noise": ((100, 12), np.float64),
        "sticky_action": ((100,), bool),
    }
    assert {key: value.shape for key, value in intervals.items()} == {"force": (20, 3), "torque": (20, 3)}
    assert randomization.draw("run", 0) == {}


@each_preset
@given(seed=st.integers(0, 2**63 - 1))
def test_every_draw_stays_in_the_allowed_range(name, seed):
    randomization = preset(name)
    values = {**randomization.draw("episode", seed), **randomization.draw_steps(seed, 5)}
    values |= randomization.draw_intervals(seed, 1.0)
    for key, value in values.items():
        low, high = randomization.terms[key].allowed
        assert np.all((np.asarray(value) >= low) & (np.asarray(value) <= high)), key


def test_none_is_nominal_and_constant():
    none = preset("none")
    values = none.draw("episode", 1)
    assert same(values, none.draw("episode", 2))
    assert [values[name] for name in ("kp", "kd", "series_stiffness", "gravity")] == [5.0, 0.36, 25.0, 9.81]
    assert np.array_equal(values["stick_friction"], np.tile([0.02, 0.02, 0.05], 4))
    steps = none.draw_steps(0, 50)
    assert not steps["joint_noise"].any() and not steps["sticky_action"].any()


def test_default_has_the_published_ranges():
    draws = [preset("default").draw("episode", seed) for seed in range(400)]
    for name, low, high in [
        ("joint_offset", -0.04, 0.04),
        ("kp", 4.8, 5.2),
        ("kd", 0.26, 0.33),
        ("series_stiffness", 15, 35),
        ("tip_friction", 0.81, 0.99),
        ("spinning_friction", 2e-4, 2e-2),
        ("object_mass_offset", -0.02, 0.02),
    ]:
        values = np.array([draw[name] for draw in draws])
        reach = high - low
        assert low <= values.min() < low + 0.05 * reach and high - 0.05 * reach < values.max() <= high, name
    stick = np.array([draw["stick_friction"] for draw in draws])
    assert stick[:, 2::3].min() >= 0.03 > stick[:, 1::3].max() >= 0.025
    steps = [preset("default").draw_steps(seed, 100) for seed in range(100)]
    assert np.std([item["joint_noise"] for item in steps]) == pytest.approx(0.02, rel=0.01)
    assert np.mean([item["sticky_action"] for item in steps]) == pytest.approx(0.1, abs=0.012)
    intervals = preset("default").draw_intervals(0, 10.0)
    assert np.allclose(np.linalg.norm(intervals["force"], axis=1), 0.04)
    assert np.allclose(np.linalg.norm(intervals["torque"], axis=1), 2e-3)


def test_each_preset_is_at_least_as_wide_as_the_one_before():
    for narrow, wide in pairwise(preset(name).terms for name in PRESETS):
        for name in narrow:
            assert np.ptp(narrow[name].distribution.support()) <= np.ptp(wide[name].distribution.support()), (
                name
            )


def test_seeds_repeat_and_differ():
    default = preset("default")
    assert same(default.draw("episode", 5), default.draw("episode", 5))
    assert default.draw("episode", 5)["kp"] != default.draw("episode", 6)["kp"]


def test_terms_do_not_disturb_each_other():
    default = preset("default")
    fewer = Randomization("fewer", [term for term in default.terms.values() if term.name != "kp"])
    full, rest = default.draw("episode", 9), fewer.draw("episode", 9)
    del full["kp"]
    assert same(full, rest)


def test_single_draws_are_the_first_rows():
    default = preset("default")
    one, many = default.draw("step", 3), default.draw_steps(3, 10)
    assert np.array_equal(one["joint_noise"], many["joint_noise"][0])
    assert one["sticky_action"] is bool(many["sticky_action"][0])
    first = default.draw("interval:0.5", 3)
    assert np.array_equal(first["force"], default.draw_intervals(3, 2.0)["force"][0])


@pytest.mark.parametrize(("duration", "rows"), [(0.1, 1), (0.5, 1), (0.6, 2), (10.0, 20)])
def test_intervals_cover_the_duration(duration, rows):
    assert len(preset("default").draw_intervals(0, duration)["force"]) == rows


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan")])
def test_bad_durations_are_refused(duration):
    with pytest.raises(RandomizationError, match="duration"):
        preset("default").draw_intervals(0, duration)


def test_unknown_times_are_refused():
    with pytest.raises(RandomizationError, match="nearest valid name: 'episode'"):
        preset("default").draw("epsiode", 0)


@each_preset
def test_replay_through_json(name):
    randomization = preset(name)
    values = randomization.draw("episode", 11)
    text = json.dumps({key: value.tolist() if np.size(value) > 1 else value for key, value in values.items()})
    replayed = randomization.replay(json.loads(text))
    assert same(replayed.draw("episode", 99), values)
    # What was not recorded is drawn as before.
    assert same(replayed.draw_steps(4, 20), randomization.draw_steps(4, 20))


@pytest.mark.parametrize(
    ("values", "message"),
    [({"kpp": 5}, "nearest valid name: 'kp'"), ({"kp": 500.0}, "allowed"), ({"joint_offset": [0, 0]}, "12")],
)
def test_replay_refuses_what_it_could_not_have_drawn(values, message):
    with pytest.raises(RandomizationError, match=message):
        preset("default").replay(values)


def test_goes_to_another_process_unchanged():
    default = preset("default")
    copy = pickle.loads(pickle.dumps(default))
    assert copy == default and hash(copy) == hash(default)
    assert same(copy.draw("episode", 1), default.draw("episode", 1))
    assert default != preset("none")


def test_an_own_term_needs_a_fitting_distribution():
    with pytest.raises(RandomizationError, match="reaches from -6 to 6"):
        Term("x", Normal(0.0, 1.0), 1, "m", (-1.0, 1.0), "run", "", "")


def test_terms_of_a_run_are_drawn_apart():
    term = Term("x", Normal(0.0, 0.1), 1, "m", (-1.0, 1.0), "run", "", "")
    randomization = Randomization("own", [*preset("none").terms.values(), term])
    assert list(randomization.draw("run", 0)) == ["x"] and "x" not in randomization.draw("episode", 0)


def test_drawing_an_episode_is_cheap():
    default = preset("default")
    times = []
    for seed in range(50):
        start = time.perf_counter()
        default.draw("episode", seed)
        times.append(time.perf_counter() - start)
    assert min(times) < 1e-3  # 0.3 ms measured; an episode's physics takes 100 times as long


def test_gravity_schedule():
    schedule = GravitySchedule(start=1.0, end=9.0, steps=100)
    assert [schedule.at(step) for step in (0, 25, 50, 100, 10**9)] == [1.0, 3.0, 5.0, 9.0, 9.0]
    assert GravitySchedule().at(0) == 9.81
    values = [schedule.at(step) for step in range(120)]
    assert all(a <= b for a, b in pairwise(values))


@pytest.mark.parametrize("bad", [{"start": -1.0}, {"end": 981.0}, {"start": float("nan")}, {"steps": -1}])
def test_bad_gravity_is_refused(bad):
    with pytest.raises(RandomizationError, match=f"gravity {next(iter(bad))}"):
        GravitySchedule(**bad)
    with pytest.raises(RandomizationError, match="step"):
        GravitySchedule().at(-1)


def test_gravity_by_equal_factors_needs_a_start_above_nothing() -> None:
    schedule = GravitySchedule(0.1, 8.1, 1000, geometric=True)
    assert schedule.at(500) == pytest.approx(0.9) and schedule.at(1000) == 8.1
    with pytest.raises(RandomizationError, match="more than 0"):
        GravitySchedule(0.0, 9.81, 1000, geometric=True)
