"""Each distribution against its own definition, and the contract all of them share."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from randomization import (
    Bernoulli,
    Constant,
    Direction,
    Distribution,
    LogUniform,
    Normal,
    RandomizationError,
    Uniform,
    stream,
)

N = 20_000
EXAMPLES = [
    Constant(0.3),
    Constant((1.0, 2.0, 3.0)),
    Uniform(-0.04, 0.04),
    Uniform((0.01, 0.01, 0.03), (0.03, 0.03, 0.09)),
    LogUniform(2e-4, 2e-2),
    Normal(1.0, 0.02),
    Normal(0.0, (0.1, 0.2, 0.3)),
    Bernoulli(0.1),
    Direction(0.04),
    Direction(Uniform(0.0, 0.1)),
]
each = pytest.mark.parametrize("distribution", EXAMPLES, ids=lambda item: item.describe())


@each
def test_contract_of_every_distribution(distribution):
    assert isinstance(distribution, Distribution)
    values = distribution.sample(stream(0, "contract"), (50, 3))
    assert values.shape == (50, 3)
    assert values.dtype == (bool if isinstance(distribution, Bernoulli) else np.float64)
    low, high = distribution.support()
    assert low <= values.min() and values.max() <= high
    assert np.array_equal(values, distribution.sample(stream(0, "contract"), (50, 3)))
    assert eval(repr(distribution)) == distribution  # a value: equal parts make it equal


@each
@given(n=st.integers(1, 20), more=st.integers(0, 20))
def test_a_longer_draw_starts_with_the_shorter_one(distribution, n, more):
    short, long = (distribution.sample(stream(3, "prefix"), (k, 3)) for k in (n, n + more))
    assert np.array_equal(short, long[:n])


@pytest.mark.parametrize(
    ("distribution", "reference"),
    [
        (Uniform(-2.0, 3.0), stats.uniform(-2, 5)),
        (LogUniform(2e-4, 2e-2), stats.loguniform(2e-4, 2e-2)),
        (Normal(0.5, 0.02), stats.norm(0.5, 0.02)),
    ],
)
def test_draws_follow_the_reference(distribution, reference):
    values = distribution.sample(stream(1, "reference"), (N, 1))[:, 0]
    assert stats.kstest(values, reference.cdf).pvalue > 1e-3


def test_bernoulli_rate():
    rate = Bernoulli(0.1).sample(stream(1, "rate"), (N, 1)).mean()
    assert abs(rate - 0.1) < 4 * np.sqrt(0.09 / N)


def test_direction_has_its_length_and_no_favourite():
    vectors = Direction(0.04).sample(stream(1, "direction"), (N, 3))
    assert np.allclose(np.linalg.norm(vectors, axis=1), 0.04, rtol=1e-12)
    # Archimedes: each coordinate of a uniform direction is uniform.
    for axis in range(3):
        assert stats.kstest(vectors[:, axis] / 0.04, stats.uniform(-1, 2).cdf).pvalue > 1e-3


def test_direction_of_random_length():
    lengths = np.linalg.norm(Direction(Uniform(0.02, 0.06)).sample(stream(1, "length"), (N, 3)), axis=1)
    assert stats.kstest(lengths, stats.uniform(0.02, 0.04).cdf).pvalue > 1e-3


def test_a_short_tuple_is_repeated():
    values = Constant((0.02, 0.02, 0.05)).sample(stream(0), (2, 12))
    assert np.array_equal(values, np.tile([0.02, 0.02, 0.05], (2, 4)))


def test_lists_and_arrays_become_tuples():
    assert Uniform([0, 1], np.array([1, 2])) == Uniform((0.0, 1.0), (1.0, 2.0))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Uniform(2, 1), "low = 2"),
        (lambda: Uniform((0, 3), (1, 2)), "low"),
        (lambda: Uniform((0, 1), (1, 2, 3)), "2 numbers and high 3"),
        (lambda: Uniform(float("nan"), 1), "finite"),
        (lambda: LogUniform(0, 1), "> 0"),
        (lambda: Normal(0, -1), "std"),
        (lambda: Normal(0, float("inf")), "finite"),
        (lambda: Bernoulli(1.1), "probability"),
        (lambda: Direction(-0.1), "magnitude"),
        (lambda: Direction(Uniform(-1, 1)), "magnitude"),
        (lambda: Direction((1, 2)), "magnitude"),
        (lambda: Constant(()), "empty"),
    ],
)
def test_bad_parameters_are_refused(make, message):
    with pytest.raises(RandomizationError, match=message):
        make()
