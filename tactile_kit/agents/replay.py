"""Replay memory that gives stored transitions new goals.

Goal and reward enter the task only through the goal rotation, so any stored transition is exact experience for any
other goal: the goal term of both observations and the rotation reward are computed anew (hindsight relabelling,
Andrychowicz et al. 2017). The reward counts *true* rotations, the observation shows the *believed* ones; both are kept.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.buffers import BaseBuffer

from tactile_kit.task import rotations

TRUE_BEFORE, TRUE_AFTER, BELIEF_BEFORE, BELIEF_AFTER = range(4)

GoalSampler = Callable[[np.random.Generator, int], NDArray[np.floating]]


@dataclass(frozen=True)
class Batch:
    """Sampled transitions, torch float32: observations ``(B, D)``, actions ``(B, A)``, the rest ``(B,)``.

    A transition is of up to n steps: ``rewards`` are summed and discounted, ``next_observations`` and ``terminated``
    are the last step's, ``discounts`` what the value there is to be weighted with.
    """

    observations: torch.Tensor
    actions: torch.Tensor
    next_observations: torch.Tensor
    rewards: torch.Tensor
    terminated: torch.Tensor
    discounts: torch.Tensor


def joined(first: Batch, second: Batch) -> Batch:
    """Both batches, one after the other."""
    return Batch(
        *(torch.cat([getattr(first, name), getattr(second, name)]) for name in Batch.__annotations__)
    )


def rotation_reward(before, after, goal, weight: float, clip: float):
    """The paper's rotation term, lambda_theta min(theta_before - theta_after, theta_clip), ``(B,)``."""
    gained = rotations.geodesic(before, goal) - rotations.geodesic(after, goal)
    return weight * np.minimum(gained, clip)


def goal_term(goal, belief):
    """The observation's goal: 6-D form of the rotation left to do, goal @ belief^T, ``(B, 6)``."""
    return np.concatenate(
        [(goal @ belief[:, 0, :, None])[..., 0], (goal @ belief[:, 1, :, None])[..., 0]], axis=1
    )


class GoalReplay(BaseBuffer):
    """A ring of ``rows`` vector steps of E environments in preallocated float32 arrays.

    Args:
        buffer_size: transitions kept (rows x E).
        observation_space, action_space: Boxes ``(D,)`` and ``(A,)``.
        n_envs: E.
        goal: slice of the goal term in the observation.
        rng: generator of everything sampled here.
        random_goals, future_goals: shares of each batch relabelled with goals of ``sample_goals`` and with
            orientations reached 1..``future_steps`` steps later in the same episode.
        rotation_weight, rotation_clip: lambda_theta and theta_clip (rad) of the reward.
        sample_goals: ``(rng, n) -> (n, 3, 3)``; uniform on SO(3) by default.
        steps: n of the n-step returns, over the actions as they were taken.
        gamma: discount.
    """

    def __init__(
        self,
        buffer_size: int,
        observation_space: spaces.Space,
        action_space: spaces.Space,
        device: torch.device | str = "cpu",
        n_envs: int = 1,
        optimize_memory_usage: bool = False,
        *,
        goal: slice,
        rng: np.random.Generator,
        random_goals: float = 0.25,
        future_goals: float = 0.25,
        future_steps: int = 50,
        rotation_weight: float = 1.0,
        rotation_clip: float = 0.1,
        sample_goals: GoalSampler = rotations.random_rotations,
        steps: int = 1,
        gamma: float = 0.95,
    ) -> None:
        super().__init__(buffer_size, observation_space, action_space, device, n_envs=n_envs)
        if optimize_memory_usage:
            raise ValueError("optimize_memory_usage: GoalReplay stores next observations; it must be False")
        if random_goals + future_goals > 1:
            raise ValueError(
                f"random_goals + future_goals = {random_goals + future_goals}, allowed at most 1"
            )
        if goal.stop - goal.start != 6:
            raise ValueError(f"goal slice {goal} has {goal.stop - goal.start} entries, needs 6")
        rows = self.rows = max(buffer_size // n_envs, 2)
        self.buffer_size = rows
        self.goal, self.rng, self.sample_goals = goal, rng, sample_goals
        self.random_goals, self.future_goals, self.future_steps = random_goals, future_goals, future_steps
        self.rotation_weight, self.rotation_clip = rotation_weight, rotation_clip
        self.steps, self.gamma = steps, gamma
        size = self.obs_shape[0]
        self.observations = np.zeros((rows, n_envs, size), np.float32)
        self.next_observations = np.zeros((rows, n_envs, size), np.float32)
        self.actions = np.zeros((rows, n_envs, self.action_dim), np.float32)
        self.rotations = np.zeros((rows, n_envs, 4, 3, 3), np.float32)  # see TRUE_BEFORE ...
        self.goals = np.zeros((rows, n_envs, 3, 3), np.float32)
        self.rotation_rewards = np.zeros((rows, n_envs), np.float32)
        self.other_rewards = np.zeros((rows, n_envs), np.float32)
        self.terminated = np.zeros((rows, n_envs), np.float32)
        self.done = np.zeros((rows, n_envs), bool)
        self.episodes = np.zeros((rows, n_envs), np.int64)  # a counter an environment
        self.times = np.full(rows, -1, np.int64)  # vector steps ever added when the row was written
        self._last_time = np.zeros(
            (rows, n_envs), np.int64
        )  # last vector step of an episode, at its counter % rows
        self._episode = np.zeros(n_envs, np.int64)
        self._time = 0

    def __len__(self) -> int:
        """Transitions stored."""
        return (self.rows if self.full else self.pos) * self.n_envs

    def add(self, observations, actions, transition) -> None:  # type: ignore[override]
        """Store one vector step.

        Args:
            observations: ``(E, D)`` before the step.
            actions: ``(E, A)`` in [-1, 1].
            transition: the environment's last transition (see the vector environment): rotations and beliefs before
                and after, goal, reward terms, terminated, truncated, next observation (terminal ones where done).
        """
        row = self.pos
        self.observations[row] = observations
        self.next_observations[row] = transition.next_observation
        self.actions[row] = actions
        self.rotations[row, :, TRUE_BEFORE] = transition.R_before
        self.rotations[row, :, TRUE_AFTER] = transition.R
        self.rotations[row, :, BELIEF_BEFORE] = transition.belief_R_before
        self.rotations[row, :, BELIEF_AFTER] = transition.belief_R
        self.goals[row] = transition.goal
        terms = transition.reward_terms
        self.rotation_rewards[row] = terms["rotation"]
        self.other_rewards[row] = sum(value for name, value in terms.items() if name != "rotation")
        self.terminated[row] = transition.terminated
        done = np.asarray(transition.terminated, bool) | np.asarray(transition.truncated, bool)
        self.done[row] = done
        self.episodes[row] = self._episode
        self.times[row] = self._time
        self._last_time[self._episode % self.rows, np.arange(self.n_envs)] = self._time
        self._episode += done
        self._time += 1
        self.pos += 1
        if self.pos == self.rows:
            self.pos, self.full = 0, True

    def fill(self, arrays: dict[str, np.ndarray]) -> None:
        """Fill all rows at once (one environment): ``observations, next_observations (N, D)``, ``actions (N, A)``,
        ``rotations (N, 4, 3, 3)``, ``goals (N, 3, 3)``, and ``(N,)``: both rewards, ``terminated``, ``done``,
        ``episodes`` (counting from 0)."""
        if self.n_envs != 1 or len(arrays["done"]) != self.rows:
            raise ValueError(
                f"{len(arrays['done'])} transitions for {self.rows} rows of {self.n_envs} environments"
            )
        for name, values in arrays.items():
            getattr(self, name)[:, 0] = values
        self.times[:] = np.arange(self.rows)
        self._last_time[self.episodes[:, 0] % self.rows, 0] = self.times  # later rows overwrite earlier ones
        self.full, self._time = True, self.rows

    def end_episodes(self) -> None:
        """The environments were reset from outside: what comes next belongs to new episodes."""
        self._episode += 1

    def sample(self, batch_size: int, env=None) -> Batch:  # type: ignore[override]
        """A batch drawn uniformly, its first shares relabelled; raises ValueError when nothing is stored."""
        stored = len(self)
        if not stored:
            raise ValueError("the replay memory is empty")
        index = self.rng.integers(0, stored, batch_size)  # row-major over (rows, E): rows fill in order
        row, column = np.divmod(index, self.n_envs)
        random_count = round(batch_size * self.random_goals)
        changed = random_count + round(batch_size * self.future_goals)
        goals = np.empty((changed, 3, 3), np.float32)
        goals[:random_count] = self.sample_goals(self.rng, random_count)
        goals[random_count:] = self._later(row[random_count:changed], column[random_count:changed])
        rewards, count = self._returns(row, column, goals)
        end = (row + count - 1) % self.rows
        observations = self._rows(self.observations, row, column)
        next_observations = self._rows(self.next_observations, end, column)
        for seen, at, which in ((observations, row, BELIEF_BEFORE), (next_observations, end, BELIEF_AFTER)):
            belief = self.rotations[at[:changed], column[:changed], which]
            seen[:changed, self.goal] = torch.from_numpy(goal_term(goals, belief))
        return Batch(
            observations,
            self._rows(self.actions, row, column),
            next_observations,
            torch.from_numpy(rewards),
            torch.from_numpy(self.terminated[end, column]),
            torch.from_numpy(self.gamma ** count.astype(np.float32)),
        )

    def _returns(self, row, column, goals):
        """Discounted sums of rewards over up to ``steps`` steps and how many these are, ``(B,)`` each.

        The first ``len(goals)`` transitions are rewarded for those goals, the others as they were.
        """
        count = np.minimum(self._ahead(row, column), self.steps)
        total, changed = np.zeros(len(row), np.float32), len(goals)
        for step in range(self.steps):
            on = np.flatnonzero(count > step)
            if not len(on):
                break
            at, env = (row[on] + step) % self.rows, column[on]
            reward = self.rotation_rewards[at, env]
            split = int(np.searchsorted(on, changed))
            if split:
                stack = self.rotations[at[:split], env[:split]]
                reward[:split] = rotation_reward(
                    stack[:, TRUE_BEFORE], stack[:, TRUE_AFTER], goals[on[:split]],
                    self.rotation_weight, self.rotation_clip,
                )  # fmt: skip
            total[on] += self.gamma**step * (reward + self.other_rewards[at, env])
        return total, count

    def _ahead(self, row, column):
        """Steps from a row to the last one stored of its episode, itself counted."""
        return self._last_time[self.episodes[row, column] % self.rows, column] - self.times[row] + 1

    def _later(self, row, column):
        """True orientations reached 1..future_steps steps later in the same episode, ``(n, 3, 3)``."""
        reach = np.minimum(self._ahead(row, column), self.future_steps)
        ahead = self.rng.integers(0, reach)  # 0: the orientation right after this step
        return self.rotations[(row + ahead) % self.rows, column, TRUE_AFTER]

    def _rows(self, array, row, column) -> torch.Tensor:
        """Entries of ``array (rows, E, ...)`` as a tensor of their own."""
        at = torch.from_numpy(row * self.n_envs + column)
        return torch.from_numpy(array).flatten(0, 1).index_select(0, at)

    def _get_samples(self, batch_inds, env=None):  # SB3's abstract hook; sample() does all of it
        raise NotImplementedError("use sample()")

    # ---- checkpoints -------------------------------------------------------------------------------------------------
    _ROWS = ("observations", "actions", "rotations", "goals", "rotation_rewards", "other_rewards", "terminated",
             "done", "episodes", "times")  # fmt: skip

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything an exact resume needs, without the rows never written.

        Next observations are mostly the following row's observations; only those that are not are listed.
        """
        rows = self.rows if self.full else self.pos
        state = {name: getattr(self, name)[:rows] for name in self._ROWS}
        state["last_time"] = self._last_time
        state["episode"] = self._episode
        state["counters"] = np.array([self.pos, self.full, self._time, self.rows, self.n_envs], np.int64)
        following = np.roll(np.arange(rows), -1)
        own = np.zeros((rows, self.n_envs), bool)
        for row in range(rows):  # row by row: comparing all at once would double the memory
            own[row] = (self.next_observations[row] != self.observations[following[row]]).any(-1)
        state["own_next"] = own
        state["next_observations"] = self.next_observations[:rows][own]
        return state

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Inverse of :meth:`arrays`; raises ValueError naming the entry whose shape or type does not fit."""
        pos, full, time, rows, envs = (int(value) for value in state["counters"])
        if (rows, envs) != (self.rows, self.n_envs):
            raise ValueError(
                f"replay of {rows} x {envs} transitions, this one holds {self.rows} x {self.n_envs}"
            )
        filled = rows if full else pos
        for name in self._ROWS:
            target = getattr(self, name)
            if state[name].shape != target[:filled].shape or state[name].dtype != target.dtype:
                raise ValueError(
                    f"replay entry {name!r} is {state[name].shape} {state[name].dtype}, "
                    f"expected {target[:filled].shape} {target.dtype}"
                )
            target[:filled] = state[name]
        self.next_observations[:filled] = self.observations[np.roll(np.arange(filled), -1)]
        self.next_observations[:filled][state["own_next"]] = state["next_observations"]
        self._last_time[:] = state["last_time"]
        self._episode[:] = state["episode"]
        self.pos, self.full, self._time = pos, bool(full), time
