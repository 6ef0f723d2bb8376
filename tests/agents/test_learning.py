"""The learner learns the toy task; its pieces follow the rules they claim."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from toy_task import ToyEnv

from tactile_kit.agents.config import NetworkConfig, PPOConfig
from tactile_kit.agents.gaussian import adapted_rate, divergence_of, log_density
from tactile_kit.agents.ppo import PPO
from tactile_kit.runs.metrics import Tracker

PPO_TOY = PPOConfig(
    rollout=32, minibatch=256, epochs=5, learning_rate=3e-4, critic_learning_rate=None, kl_threshold=0.016, gamma=0.99,
    log_std=-0.5, noise_correlation=0.0, bfloat16=False,
    actor=NetworkConfig(hidden=(64, 64)), critic=NetworkConfig(hidden=(64, 64)),
)  # fmt: skip


@pytest.fixture(autouse=True)
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def run(learner, iterations: int) -> list[float]:
    """Mean final angles of the first and the last fifth of the episodes."""
    tracker, angles = Tracker(), []
    learner._setup_learn(10**9, tracker)
    for _ in range(iterations):
        before = tracker.episodes
        learner.iterate(tracker)
        new = min(tracker.episodes - before, len(tracker.window["theta"]))
        angles += list(tracker.window["theta"])[len(tracker.window["theta"]) - new :] if new else []
    fifth = len(angles) // 5
    return [float(np.mean(angles[:fifth])), float(np.mean(angles[-fifth:]))]


def test_ppo_improves_with_correlated_noise_and_a_critic_that_keeps_its_learning_rate() -> None:
    """The actor's follows the divergence as before; a checkpoint keeps both."""
    config = PPO_TOY.model_copy(update={"noise_correlation": 0.6, "critic_learning_rate": 7e-4})
    learner = PPO(ToyEnv(32, seed=1), config, seed=0)
    first, last = run(learner, 30)
    assert first > 1.2 and last < 0.95
    actor, critic = learner.policy.optimizer.param_groups
    assert critic["lr"] == 7e-4 and actor["lr"] == learner.rate != config.learning_rate
    assert len(actor["params"]) + len(critic["params"]) == len(list(learner.policy.parameters()))
    again = PPO(ToyEnv(32, seed=1), config, seed=1)
    again.restore(*learner.state())
    assert [group["lr"] for group in again.policy.optimizer.param_groups] == [learner.rate, 7e-4]


def test_sigma_is_kept_under_its_ceiling() -> None:
    learner = PPO(ToyEnv(8, seed=1), PPO_TOY, seed=0)
    run(learner, 2)
    assert learner.policy.actor.log_std.mean().item() == pytest.approx(-0.5, abs=0.05)
    learner.ceiling = -3.0
    run(learner, 1)
    assert learner.policy.actor.log_std.mean().item() == pytest.approx(-3.0, abs=0.05)


@pytest.mark.parametrize(
    ("environments", "minibatch", "threads"), [(32, 256, 1), (33, 100, 1), (40, 1280, 2)]
)
def test_rounding_does_not_pass_for_divergence(environments: int, minibatch: int, threads: int) -> None:
    """However small sigma is: a policy that stays is to the bit what collected, in batches of whatever size."""
    still = {
        "bfloat16": True,
        "log_std": -7.0,
        "learning_rate": 1e-30,
        "learning_rate_bounds": (1e-30, 1e-30),
    }
    config = PPO_TOY.model_copy(update={**still, "minibatch": minibatch, "noise_correlation": 0.5})
    learner = PPO(ToyEnv(environments, seed=1), config, rest=(0.3,) * 12, seed=0, threads=threads)
    learner.policy.actor.mean.weight.data.mul_(50.0)  # means of some size
    run(learner, 1)
    metrics = learner.metrics()
    assert metrics["divergence"] == pytest.approx(0.0, abs=1e-9) and metrics["clipped"] == 0.0
    assert learner.rollout_buffer.means.std() > 1e-3  # 1 sigma and more


def test_ppos_noise_is_as_correlated_and_as_large_as_asked() -> None:
    """Over whole episodes; and the stored density is that of the action given the noise left over."""
    config = PPO_TOY.model_copy(update={"noise_correlation": 0.7, "rollout": 128})
    learner = PPO(ToyEnv(64, seed=1, horizon=1000), config, seed=0)
    tracker = Tracker()
    learner._setup_learn(10**9, tracker)
    assert learner.env is not None
    learner.collect_rollouts(learner.env, tracker, learner.rollout_buffer, 128)
    buffer = learner.rollout_buffer
    with torch.no_grad():
        means = learner.policy.heads(
            learner.policy.norm(torch.from_numpy(buffer.observations).flatten(0, 1))
        )[0]
    sigma = learner.policy.actor.log_std.detach().exp()
    noise = (torch.from_numpy(buffer.actions) - means.reshape(128, 64, -1))[
        40:
    ] / sigma  # after its start at zero
    assert noise.std() == pytest.approx(1.0, abs=0.03)
    assert (noise[1:] * noise[:-1]).mean() == pytest.approx(0.7, abs=0.03)
    left = buffer.left_over[40:] / sigma
    new = (noise - left) / (1 - 0.7**2) ** 0.5
    density = (-0.5 * new.square() - 0.5 * math.log(2 * math.pi) - (sigma * (1 - 0.7**2) ** 0.5).log()).sum(
        -1
    )
    np.testing.assert_allclose(buffer.log_probs[40:], density.numpy(), atol=1e-3)


def test_ppo_improves() -> None:
    first, last = run(PPO(ToyEnv(32, seed=1), PPO_TOY, seed=0), 30)
    assert first > 1.2 and last < 0.85


def test_sb3_learn_works_too() -> None:
    ppo = PPO(ToyEnv(8), PPO_TOY, seed=0)
    ppo.learn(512)
    assert ppo.num_timesteps == 512 and ppo._n_updates == 2 * 5 * 1


def test_threads_share_the_work_and_repeat_to_the_bit() -> None:
    """Two threads learn what one does but for rounding, and the same every time."""
    weights, divergences = [], []
    for threads in (1, 2, 2):
        config = PPO_TOY.model_copy(update={"epochs": 1, "minibatch": 1024, "noise_correlation": 0.6})
        learner = PPO(ToyEnv(33, seed=1), config, seed=0, threads=threads)  # parts of different sizes
        run(learner, 2)
        weights.append(torch.cat([p.detach().flatten() for p in learner.policy.parameters()]))
        divergences.append(learner.metrics()["divergence"])
    one, two, again = weights
    assert torch.equal(two, again) and divergences[1] == divergences[2]
    start = torch.cat([p.detach().flatten() for p in PPO(ToyEnv(33), config, seed=0).policy.parameters()])
    assert (one - two).norm() < 0.02 * (one - start).norm()
    assert divergences[1] == pytest.approx(divergences[0], rel=0.02)


def test_runs_repeat_whatever_the_global_generators_hold() -> None:
    results = []
    for global_seed in (0, 1):
        torch.manual_seed(global_seed)
        np.random.seed(global_seed)
        before = torch.get_rng_state()
        ppo = PPO(ToyEnv(8), PPO_TOY, seed=7)
        ppo.learn(512)
        assert torch.equal(before, torch.get_rng_state())
        results.append([p.detach().clone() for p in ppo.policy.parameters()])
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))
    other = PPO(ToyEnv(8), PPO_TOY, seed=8)
    assert not all(torch.equal(a, b) for a, b in zip(other.policy.parameters(), results[0], strict=True))


def test_bfloat16_updates_stay_close_and_finite() -> None:
    losses = []
    for bfloat16 in (False, True):
        ppo = PPO(ToyEnv(8), PPO_TOY.model_copy(update={"bfloat16": bfloat16}), seed=0)
        ppo.learn(512)
        losses.append(ppo.metrics()["value_loss"])
    assert losses[1] == pytest.approx(losses[0], rel=0.1) and losses[0] != losses[1]


@pytest.mark.parametrize(
    ("divergence", "expected"),
    [(0.1, 1e-3 / 1.5), (0.033, 1e-3 / 1.5), (0.032, 1e-3), (0.016, 1e-3), (0.008, 1e-3), (0.0079, 1.5e-3)],
)
def test_learning_rate_rule(divergence: float, expected: float) -> None:
    assert adapted_rate(1e-3, divergence, 0.016, (1e-6, 1e-2)) == pytest.approx(expected)


def test_learning_rate_stays_in_bounds() -> None:
    assert adapted_rate(1.2e-6, 1.0, 0.016, (1e-6, 1e-2)) == 1e-6
    assert adapted_rate(9e-3, 0.0, 0.016, (1e-6, 1e-2)) == 1e-2


def test_divergence_and_density_against_torch() -> None:
    torch.manual_seed(0)
    mean, old = torch.randn(9, 4), torch.randn(9, 4)
    log_std, old_log_std = torch.randn(4) * 0.3, torch.randn(4) * 0.3
    p = torch.distributions.Normal(old, old_log_std.exp().expand(9, 4))
    q = torch.distributions.Normal(mean, log_std.exp().expand(9, 4))
    wanted = torch.distributions.kl_divergence(p, q).sum(1).mean()
    torch.testing.assert_close(divergence_of(mean, log_std, old, old_log_std), wanted)
    x = torch.randn(9, 4)
    torch.testing.assert_close(log_density(x, mean, log_std), q.log_prob(x).sum(1))


def test_ppo_bootstraps_time_outs_and_nothing_else() -> None:
    ppo = PPO(ToyEnv(3), PPO_TOY, seed=0)
    observation = np.ones(ppo.observation_space.shape, np.float32)
    infos = [
        {"terminal_observation": observation, "TimeLimit.truncated": True},
        {"terminal_observation": observation, "TimeLimit.truncated": False},
        {},
    ]
    rewards = ppo._bootstrap(np.zeros(3, np.float32), infos, np.array([True, True, False]))
    with torch.no_grad():
        value = ppo.policy.predict_values(torch.from_numpy(observation[None])).item()
    assert rewards.tolist() == pytest.approx([0.99 * value, 0.0, 0.0]) and value != 0


def test_ppo_normaliser_moves_after_the_update_only() -> None:
    ppo = PPO(ToyEnv(8), PPO_TOY, seed=0)
    counts = []
    train = ppo.train
    ppo.train = lambda: (counts.append(float(ppo.policy.norm.count[0])), train())  # type: ignore[method-assign]
    ppo.learn(3 * 8 * 32)
    assert counts == [0.0, 256.0, 512.0]


def test_divergence_of_learning_is_an_error() -> None:
    ppo = PPO(ToyEnv(4), PPO_TOY, seed=0)
    with torch.no_grad():
        ppo.policy.critic.head.weight[0, 0] = math.nan
    ppo.learn(128)
    with pytest.raises(FloatingPointError, match="learning diverged"):
        ppo.metrics()
