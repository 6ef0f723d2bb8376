"""Replay with new goals: recomputed observations and rewards are those the task itself would have given."""

from __future__ import annotations

import numpy as np
import pytest
from toy_task import ACTIONS, ToyEnv

from tactile_kit.agents.replay import BELIEF_AFTER, BELIEF_BEFORE, TRUE_AFTER, GoalReplay
from tactile_kit.task import rotations


def filled(added: int, capacity: int = 4000, envs: int = 8, **settings) -> tuple[GoalReplay, ToyEnv, list]:
    env = ToyEnv(envs, seed=3, horizon=12, belief_error=0.3, drop=0.05)
    memory = GoalReplay(
        capacity,
        env.observation_space,
        env.action_space,
        n_envs=envs,
        goal=env.layout.slice("goal"),
        rng=np.random.default_rng(0),
        **settings,
    )
    rng = np.random.default_rng(1)
    observations, log = env.reset(), []
    for _ in range(added):
        actions = rng.uniform(-1, 1, (envs, ACTIONS)).astype(np.float32)
        following, rewards, _, _ = env.step(actions)
        memory.add(observations, actions, env.transition)
        log.append((observations, actions, env.transition, rewards))
        observations = following
    return memory, env, log


def match(memory: GoalReplay, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Row and environment of sampled transitions, found by their actions, which are all different."""
    flat = memory.actions.reshape(-1, ACTIONS)
    index = np.array([np.flatnonzero((flat == action).all(1))[0] for action in actions])
    return np.divmod(index, memory.n_envs)


def test_without_relabelling_the_stored_transitions_come_back() -> None:
    memory, _, log = filled(40, random_goals=0.0, future_goals=0.0)
    batch = memory.sample(200)
    row, env = match(memory, batch.actions.numpy())
    for i in range(200):
        observations, _, transition, rewards = log[row[i]]
        np.testing.assert_array_equal(batch.observations[i], observations[env[i]])
        np.testing.assert_array_equal(batch.next_observations[i], transition.next_observation[env[i]])
        assert batch.rewards[i] == pytest.approx(rewards[env[i]], abs=1e-6)
        assert batch.terminated[i] == transition.terminated[env[i]]
    assert 0 < batch.terminated.mean() < 1


def test_the_own_goal_gives_the_own_reward_and_observation() -> None:
    memory, _, _ = filled(40, random_goals=1.0, future_goals=0.0)
    chosen: list[np.ndarray] = []

    def same(rng, count):  # the goal each transition had; the buffer asks after drawing rows
        return chosen[0]

    rng = np.random.default_rng(0)
    index = rng.integers(0, len(memory), 300)
    row, column = np.divmod(index, memory.n_envs)
    chosen.append(memory.goals[row, column])
    memory.sample_goals, memory.rng = same, np.random.default_rng(0)
    batch = memory.sample(300)
    np.testing.assert_allclose(batch.observations, memory.observations[row, column], atol=2e-6)
    np.testing.assert_allclose(batch.next_observations, memory.next_observations[row, column], atol=2e-6)
    stored = memory.rotation_rewards[row, column] + memory.other_rewards[row, column]
    np.testing.assert_allclose(batch.rewards, stored, atol=3e-6)


def test_random_goals_are_what_the_task_would_have_computed() -> None:
    memory, env, _ = filled(60, random_goals=1.0, future_goals=0.0)
    batch = memory.sample(256)
    row, column = match(memory, batch.actions.numpy())
    memory.rng = np.random.default_rng(0)
    memory.rng.integers(0, len(memory), 256)
    goals = rotations.random_rotations(memory.rng, 256).astype(np.float32)
    part = env.layout.slice("goal")
    stack = memory.rotations[row, column].astype(np.float64)
    for side, observed in ((BELIEF_BEFORE, batch.observations), (BELIEF_AFTER, batch.next_observations)):
        wanted = rotations.to_6d(goals @ stack[:, side].transpose(0, 2, 1))
        np.testing.assert_allclose(observed[:, part], wanted, atol=1e-6)
    turned = rotations.geodesic(stack[:, 0], goals) - rotations.geodesic(stack[:, TRUE_AFTER], goals)
    wanted = np.minimum(turned, 0.1) + memory.other_rewards[row, column]
    np.testing.assert_allclose(batch.rewards, wanted, atol=5e-6)
    rest = np.delete(np.arange(env.layout.size), np.arange(part.start, part.stop))
    np.testing.assert_array_equal(batch.observations[:, rest], memory.observations[row, column][:, rest])


@pytest.mark.parametrize(
    ("capacity", "steps"), [(4000, 90), (30 * 8, 103)], ids=["growing", "wrapped around"]
)
def test_future_goals_come_from_later_in_the_same_episode(capacity: int, steps: int) -> None:
    memory, _, log = filled(steps, capacity, random_goals=0.0, future_goals=1.0, future_steps=5)
    memory.goals[:] = 0
    lags = []
    for _ in range(8):
        index = memory.rng.integers(0, len(memory), 64)
        row, column = np.divmod(index, memory.n_envs)
        found = memory._later(row, column)
        for i in range(64):
            now = memory.times[row[i]]
            ends = [t for t in range(now, steps) if (log[t][2].terminated | log[t][2].truncated)[column[i]]]
            last = min(ends[0] if ends else steps - 1, now + 4)
            angles = [
                rotations.geodesic(log[t][2].R[column[i]].astype(np.float32), found[i])
                for t in range(now, last + 1)
            ]
            assert min(angles) < 1e-3
            lags.append(int(np.argmin(angles)))
    assert set(lags) == set(range(5))


def test_shares_of_a_batch() -> None:
    memory, env, _ = filled(50)
    batch = memory.sample(512)
    row, column = match(memory, batch.actions.numpy())
    part = env.layout.slice("goal")
    kept = (batch.observations[:, part].numpy() == memory.observations[row, column][:, part]).all(1)
    assert not kept[:256].any() or kept[:256].sum() < 3
    assert kept[256:].all()


def test_ends_of_episodes_from_outside_are_boundaries() -> None:
    memory, _, _ = filled(3, envs=4, random_goals=0.0, future_goals=1.0)
    memory.end_episodes()
    before = memory.episodes[2].copy()
    _, env, _ = filled(1, envs=4)
    memory.add(env.reset(), np.zeros((4, ACTIONS), np.float32), env.transition)
    assert (memory.episodes[3] > before).all()


def test_state_survives_a_round_trip_and_continues_alike() -> None:
    for steps, capacity in ((20, 4000), (70, 30 * 8)):
        memory, env, _ = filled(steps, capacity)
        state = {name: np.array(value) for name, value in memory.arrays().items()}
        assert state["next_observations"].shape[0] < 0.3 * len(memory)
        other, _, _ = filled(1, capacity)
        other.restore(state)
        other.rng = np.random.default_rng(5)
        memory.rng = np.random.default_rng(5)
        transition = env.transition
        for each in (memory, other):
            each.add(transition.next_observation, np.ones((8, ACTIONS), np.float32), transition)
        a, b = memory.sample(256), other.sample(256)
        for name in ("observations", "actions", "next_observations", "rewards", "terminated"):
            assert (getattr(a, name) == getattr(b, name)).all(), name


def test_bad_settings_and_states_are_refused() -> None:
    memory, env, _ = filled(3)
    with pytest.raises(ValueError, match="at most 1"):
        filled(1, random_goals=0.7, future_goals=0.5)
    with pytest.raises(ValueError, match="holds"):
        filled(1, capacity=800)[0].restore(memory.arrays())
    state = memory.arrays()
    state["actions"] = state["actions"].astype(np.float64)
    with pytest.raises(ValueError, match="'actions'"):
        memory.restore(state)
    fresh = GoalReplay(
        100, env.observation_space, env.action_space, n_envs=8,
        goal=env.layout.slice("goal"), rng=np.random.default_rng(0),
    )  # fmt: skip
    with pytest.raises(ValueError, match="empty"):
        fresh.sample(4)


def test_returns_of_several_steps_are_summed_within_the_episode() -> None:
    """Step by step from the log: rewards as given where the goal stays, and never across an episode's end."""
    memory, _, log = filled(60, random_goals=0.0, future_goals=0.0, steps=4, gamma=0.9)
    batch = memory.sample(300)
    rows, columns = match(memory, batch.actions.numpy())
    lengths = []
    for i, (row, column) in enumerate(zip(rows, columns, strict=True)):
        total, weight, length = 0.0, 1.0, 0
        for later in range(row, min(row + 4, len(log))):
            total, weight, length = total + weight * log[later][3][column], weight * 0.9, length + 1
            if memory.done[later, column]:
                break
        lengths.append(length)
        end = row + length - 1
        assert batch.rewards[i] == pytest.approx(total, abs=1e-5)
        assert batch.discounts[i] == pytest.approx(weight, rel=1e-5)
        assert batch.terminated[i] == log[end][2].terminated[column]
        np.testing.assert_array_equal(batch.next_observations[i], log[end][2].next_observation[column])
    assert {1, 2, 3, 4} == set(lengths)


def test_returns_of_several_steps_are_for_the_new_goal() -> None:
    memory, _, _ = filled(60, random_goals=1.0, future_goals=0.0, steps=3, gamma=0.9)
    goals = rotations.random_rotations(np.random.default_rng(5), 200).astype(np.float32)
    memory.sample_goals = lambda rng, n: goals[:n]
    batch = memory.sample(200)
    rows, columns = match(memory, batch.actions.numpy())
    for i, (row, column) in enumerate(zip(rows, columns, strict=True)):
        count = round(np.log(float(batch.discounts[i])) / np.log(0.9))
        total = 0.0
        for step in range(count):
            before, after = (
                memory.rotations[row + step, column, 0],
                memory.rotations[row + step, column, TRUE_AFTER],
            )
            gained = float(rotations.geodesic(before, goals[i]) - rotations.geodesic(after, goals[i]))
            total += 0.9**step * (min(gained, 0.1) + memory.other_rewards[row + step, column])
        assert batch.rewards[i] == pytest.approx(total, abs=1e-4)
