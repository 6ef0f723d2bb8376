"""Intervals against closed forms, against known coverage, and against cases worked by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

import randomization
from tactile_kit.evaluation import EvaluationError, difference, stratified_bootstrap, wilson

counts = st.integers(1, 5000).flatmap(
    lambda n: st.tuples(st.one_of(st.integers(0, n), st.sampled_from([0, n])), st.just(n))
)


@given(counts)
def test_wilson_agrees_with_scipy(counted):
    successes, episodes = counted
    theirs = binomtest(successes, episodes).proportion_ci(method="wilson")
    assert wilson(successes, episodes) == pytest.approx((theirs.low, theirs.high), abs=1e-12)


def test_wilson_by_hand():
    # z = 1.959964: centre (.5 + z^2/20) / (1 + z^2/10) = .5, half width .2634
    assert wilson(5, 10) == pytest.approx((0.2366, 0.7634), abs=1e-4)
    assert wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert wilson(10, 10) == pytest.approx((0.7225, 1.0), abs=1e-4)


@given(st.integers(1, 10**6), st.floats(0.5, 0.999))
def test_none_and_all_have_a_width(n, confidence):
    """No successes of n say something about n, and all of n the mirror image of it."""
    none, all_of_them = wilson(0, n, confidence), wilson(n, n, confidence)
    assert none.low == 0.0 and all_of_them.high == 1.0
    assert 0.0 < none.high < 1.0 and all_of_them.low == pytest.approx(1.0 - none.high, abs=1e-12)
    assert wilson(0, n + 1, confidence).high < none.high  # more episodes, less doubt


@given(counts, counts)
def test_difference_holds_what_was_seen_and_stays_in_range(first, second):
    low, high = difference(*first, *second)
    seen = first[0] / first[1] - second[0] / second[1]
    assert -1.0 - 1e-12 <= low <= seen + 1e-12 and seen - 1e-12 <= high <= 1.0 + 1e-12 and low < high


@pytest.mark.parametrize("n", [1, 24, 5000])
def test_difference_of_none_and_all(n):
    low, high = difference(n, n, 0, n)
    assert high == 1.0 and low == pytest.approx(1.0 - np.sqrt(2) * wilson(0, n).high)
    low, high = difference(0, n, 0, n)
    assert low == -high and high == pytest.approx(wilson(0, n).high)


def test_wilson_covers_the_truth_as_often_as_it_says():
    draws = randomization.stream(0, "test", "wilson").binomial(100, 0.9, size=4000)
    covered = [low <= 0.9 <= high for low, high in (wilson(int(k), 100) for k in draws)]
    assert 0.93 < np.mean(covered) < 0.97


@pytest.mark.parametrize("successes, episodes", [(1, 0), (-1, 5), (6, 5)])
def test_impossible_counts_are_refused(successes, episodes):
    with pytest.raises(EvaluationError, match="allowed"):
        wilson(successes, episodes)


def test_difference_by_hand():
    # Newcombe (1998), table II, example (a): 56/70 and 48/80, method 10: 0.0524 to 0.3339
    assert difference(56, 70, 48, 80) == pytest.approx((0.0524, 0.3339), abs=1e-4)


def test_difference_turns_round_with_its_sides():
    low, high = difference(30, 40, 10, 50)
    assert difference(10, 50, 30, 40) == pytest.approx((-high, -low))


def test_bootstrap_of_a_mean_has_the_known_width():
    values = randomization.stream(0, "test", "bootstrap").normal(2.0, 3.0, size=900)
    low, high = stratified_bootstrap(
        [values], lambda s: s[0].mean(), generator=randomization.stream(1, "b"), replicates=4000
    )
    assert high - low == pytest.approx(2 * 1.96 * values.std() / 30, rel=0.06)
    assert low < values.mean() < high


def test_bootstrap_keeps_strata_apart():
    # Within each stratum nothing varies; resampling across them would.
    low, high = stratified_bootstrap(
        [np.zeros(5), np.ones(5)], lambda s: np.concatenate(s).mean(), generator=randomization.stream(0, "b")
    )
    assert low == high == 0.5


def test_bootstrap_of_curves_keeps_their_shape():
    curves = randomization.stream(0, "test", "curves").normal(size=(3, 7))
    low, high = stratified_bootstrap([curves], lambda s: s[0].mean(0), generator=randomization.stream(0, "b"))
    assert low.shape == high.shape == (7,) and (low <= high).all()


def test_one_seed_gives_no_interval():
    with pytest.raises(EvaluationError, match="two or more"):
        stratified_bootstrap([np.ones(1)], lambda s: s[0].mean(), generator=randomization.stream(0, "b"))
