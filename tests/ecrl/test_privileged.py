"""A critic that sees the truth: the agent's own observation is as without, and what is shipped reads no more."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from estimator_cases import TINY

from tactile_kit.agents.networks import InputLayout
from tactile_kit.ecrl import ECRLConfig, TactileVecEnv
from tactile_kit.ecrl.privileged import TERMS, WIDTH
from tactile_kit.estimator.fingers import RADII
from tactile_kit.hand import kinematics
from tactile_kit.rotations import to_6d
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.variants import prepare

TASK = TaskConfig(objects="cube", horizon=5, grasps=2)


@pytest.fixture(scope="module")
def envs():
    variants = prepare(TASK)
    made = []
    for sees in (False, True):
        ecrl = ECRLConfig(rollout=4, reuse=1, kept=1, rho_start=0.0, critic_sees_truth=sees)
        made.append(
            TactileVecEnv(
                TASK, num_envs=3, num_workers=0, seed=5, variants=variants, estimator=TINY, ecrl=ecrl
            )
        )
    yield made
    for env in made:
        env.close()


def test_truth_stands_behind_the_agents_own_terms(envs) -> None:
    plain, seeing = envs
    size = plain.layout.size
    assert seeing.layout.size == size + WIDTH == seeing.observation_space.shape[0]
    rng = np.random.default_rng(0)
    pairs = [(plain.reset(), seeing.reset())]
    before = seeing.state.x.copy()
    for _ in range(7):  # over an episode's end
        action = rng.uniform(-0.4, 0.2, (3, 12)).astype(np.float32)
        one, other = plain.step(action), seeing.step(action)
        pairs.append((one[0], other[0]))
        state, private = seeing.state, other[0][:, size:]
        np.testing.assert_allclose(private[:, :6], to_6d(state.goal @ state.R.transpose(0, 2, 1)), atol=1e-6)
        np.testing.assert_allclose(private[:, 6:9], state.x, atol=1e-6)
        moved = np.where(other[2][:, None], 0.0, state.x - before)
        np.testing.assert_allclose(private[:, 15:18], moved, atol=1e-6)
        for i in np.flatnonzero(other[2]):
            ended = other[3][i]["terminal_observation"]
            np.testing.assert_array_equal(ended[:size], one[3][i]["terminal_observation"])
            assert (
                np.abs(ended[size + 6 : size + 9] - state.x[i]).max() > 1e-4
            )  # of the end, not of the next start
        before = state.x.copy()
    for own, whole in pairs:
        np.testing.assert_array_equal(own, whole[:, :size])


def test_clearances_are_those_of_the_true_fingers(envs) -> None:
    _, seeing = envs
    seen = seeing.reset()[0, -len(RADII) :]
    tips = kinematics.tip_centres(seeing.simulation.views["q0"][0])
    state = seeing.state
    local = (tips - state.x[0]) @ state.R[0]
    half = seeing.variants.objects[int(state.variant[0])].extents / 2
    # chamfered edges aside, a cube's distance is a box's
    outside = np.linalg.norm(np.maximum(np.abs(local) - half, 0.0), axis=1)
    np.testing.assert_allclose(seen.reshape(4, 4)[:, 2] + RADII[0].item(), outside, atol=1.5e-3)


def test_the_actor_reads_its_own_terms_alone(envs) -> None:
    from tactile_kit.agents.config import PPOConfig
    from tactile_kit.agents.ppo import PPO
    from tactile_kit.runs.export import _own_tensors

    _, seeing = envs
    learner = PPO(seeing, PPOConfig(rollout=4, minibatch=6))
    assert "true_pose" not in dict(learner.input_layout.terms)
    observation = torch.from_numpy(seeing.reset())
    other = observation.clone()
    other[:, -WIDTH:] += 1.0
    with torch.no_grad():
        mean, _, value = learner.policy.heads(learner.policy.norm(observation))
        same, _, elsewhere = learner.policy.heads(learner.policy.norm(other))
    assert torch.equal(mean, same)
    assert not torch.allclose(value, elsewhere)
    size = learner.input_layout.size
    shipped = _own_tensors(learner.policy.actor)
    assert {len(t) for name, t in shipped.items() if ".norm." in name} == {size}


def test_only_last_terms_can_be_left_out() -> None:
    layout = InputLayout((("a", 2), ("b", 3), *TERMS.items()))
    assert layout.without(TERMS).terms == (("a", 2), ("b", 3))
    with pytest.raises(ValueError, match="not the last"):
        layout.without({"a"})
