"""The Kalman filter beside a shipped policy in the compiled physics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from tactile_kit.agents.agent import load_agent
from tactile_kit.errors import EvaluationError
from tactile_kit.estimator import KalmanFilter, Rest
from tactile_kit.evaluation.estimates import follow
from tactile_kit.evaluation.estimators import told

pytestmark = pytest.mark.slow

ORACLE = Path(__file__).parents[2] / "results" / "agents" / "oracle-vec_bps-geometric8-s0"


@pytest.fixture(scope="module")
def followed():
    torch.set_num_threads(1)
    oracle = load_agent(ORACLE)
    return {
        name: follow(oracle.told_by(told), "cube", truth=True, episodes=32, seed=1)
        for name, told in (("filter", KalmanFilter()), ("rest", Rest()))
    }


def test_the_policy_that_is_told_the_truth_plays_the_same_whoever_follows(followed) -> None:
    np.testing.assert_array_equal(followed["filter"].goal, followed["rest"].goal)
    assert followed["filter"].figures()["success"] > 0.8


def test_the_filter_follows_for_a_while_and_says_less_and_less_surely(followed) -> None:
    found, rest = followed["filter"].figures(), followed["rest"].figures()
    assert found["mean_1s"] < 0.85 * rest["mean_1s"]
    sigma = followed["filter"].sigma
    assert np.nanmean(sigma[0]) < 0.5 * np.nanmean(sigma[20])
    assert np.nanmax(sigma) < 3**0.5 * 0.8 + 1e-6
    assert np.nanmax(np.abs(followed["filter"].position)) < 0.2


def test_another_agents_cell_may_tell_what_it_believes(followed) -> None:
    oracle = load_agent(ORACLE)
    tactile = ORACLE.with_name("tactile-vec_bps-geometric8-s0")
    cell = follow(told(oracle, str(tactile)), "cube", truth=True, episodes=32, seed=1)
    np.testing.assert_array_equal(cell.goal, followed["rest"].goal)
    assert cell.figures()["mean_1s"] < 0.6 * followed["filter"].figures()["mean_1s"]
    with pytest.raises(EvaluationError, match="an oracle has no estimator"):
        told(oracle, str(ORACLE))
