"""Estimators side by side: none hears the others, all follow the same episodes, and courses say what happened."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import object_sets
import randomization
from tactile_kit.agents.agent import load_agent
from tactile_kit.errors import EvaluationError
from tactile_kit.estimator import KalmanFilter, Rest
from tactile_kit.evaluation.chorus import Chorus, Timed
from tactile_kit.evaluation.playing import play
from tactile_kit.rotations import random_rotations
from tactile_kit.shape import MeshTable, encoding

AGENTS = Path(__file__).parents[2] / "results" / "agents"
ORACLE, TACTILE = AGENTS / "oracle-vec_bps-geometric8-s0", AGENTS / "tactile-vec_bps_fingers-geometric8-s0"


@pytest.fixture(scope="module")
def voices():
    torch.set_num_threads(1)
    return {"kalman": KalmanFilter(), "cell": load_agent(TACTILE).estimator, "rest": Rest()}


def test_each_believes_what_it_would_believe_alone(voices):
    things = list(object_sets.load("all"))[:2]
    shape = encoding("vec_bps", MeshTable.from_meshes([(thing.vertices, thing.faces) for thing in things]))
    rng = randomization.stream(0, "test", "chorus")
    R0 = torch.from_numpy(random_rotations(rng, 4).astype(np.float32))
    mesh, restarted = torch.tensor([0, 1, 0, 1]), torch.tensor([False, True, False, False])
    chorus = Chorus({name: Timed(voice) for name, voice in voices.items()})
    together = chorus.initial(R0)
    alone = {name: voice.initial(R0) for name, voice in voices.items()}
    for step in range(4):
        z = torch.from_numpy(0.3 * rng.standard_normal((4, 144)).astype(np.float32))
        together = chorus(together, z, shape, mesh)
        for name, voice in voices.items():
            with torch.no_grad():
                alone[name] = voice(alone[name], z, shape, mesh)
                sigma = voice.sigmas(alone[name])
            belief = chorus.beliefs[name]
            np.testing.assert_array_equal(belief.R, alone[name].R.numpy())
            np.testing.assert_array_equal(belief.x, alone[name].x.numpy())
            np.testing.assert_array_equal(belief.sigma, sigma.numpy())
        if step == 1:  # an episode begins in the second environment
            together = together.replaced(restarted, chorus.initial(R0))
            alone = {
                name: state.replaced(restarted, voices[name].initial(R0)) for name, state in alone.items()
            }
    for voice in chorus.voices.values():
        cost = voice.cost()
        assert cost["environments"] == 4 and cost["calls"] == 4 and 0 < cost["low"] <= cost["median"]


def test_only_an_oracle_is_followed_by_estimators_that_read_as_it_does(voices):
    with pytest.raises(EvaluationError, match="this is a tactile"):
        Chorus(voices).beside(load_agent(TACTILE))
    with pytest.raises(EvaluationError, match="reads encoding 'vec_bps'"):
        Chorus(voices).beside(load_agent(AGENTS / "oracle-pos-geometric8-s0"))
    with pytest.raises(EvaluationError, match="one or more"):
        Chorus({})


@pytest.mark.slow
def test_all_follow_the_same_episodes(voices):
    settings = {"objects": "cube,apple", "goals_per_case": 2, "num_workers": 0, "quiet": True}
    lines = play(load_agent(ORACLE), "truth", (1.0, 10.0), arrivals=True, followers=voices, **settings)
    by_name = {name: [line for line in lines if line.condition == name] for name in ("truth", *voices)}
    assert [len(mine) for mine in by_name.values()] == [len(by_name["truth"])] * 4
    assert sum(bool(line.end) for line in by_name["truth"]) == 4
    for name, mine in by_name.items():
        assert [(m.seed, m.time, m.theta, m.end) for m in mine] == [
            (m.seed, m.time, m.theta, m.end) for m in by_name["truth"]
        ]
        assert all(m.symmetric <= m.error + 1e-6 for m in mine)
        assert all(m.symmetric == pytest.approx(m.error, abs=1e-6) for m in mine if m.object == "apple")
        assert (max(m.error for m in mine) == 0) == (name == "truth")
    arrived = {m.seed for m in by_name["truth"] if m.theta < 0.4 and not m.end}
    assert {m.seed for m in by_name["truth"] if m.success} <= arrived
    starts = [m for mine in by_name.values() for m in mine if m.time == 0]
    assert len(starts) == 4 * 4 and all(
        m.error < 1e-6 and m.theta == m.believed for m in starts if not m.sigma
    )
    early = [m for m in by_name["truth"] if m.time not in (0.0, 1.0, 10.0) and not m.end]
    assert all(m.theta < 0.4 for m in early)
    assert len(early) == len({m.seed for m in early})  # the first arrival alone
    errors = {name: np.mean([m.error for m in mine if m.end]) for name, mine in by_name.items()}
    assert errors["cell"] < errors["rest"]
