"""A reorientation task without physics that keeps the vector environment's contract.

The action's first three entries are an angular velocity; the body turns by exactly that. Same observation terms,
reward terms, transition and infos as the real task, so that learners are tested on the real interface in seconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

from randomization import stream
from tactile_kit import rotations

ACTIONS = 12
SPEED = 0.3  # rad a step at full action


class ToyLayout:
    def __init__(self, **sizes: int) -> None:
        self.sizes = sizes

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.sizes)

    @property
    def size(self) -> int:
        return sum(self.sizes.values())

    def slice(self, name: str) -> slice:
        start = 0
        for other, size in self.sizes.items():
            if other == name:
                return slice(start, start + size)
            start += size
        raise KeyError(name)


@dataclass
class ToyTransition:
    reward_terms: dict[str, np.ndarray]


class ToyEnv(VecEnv):
    """Args: belief_error, rad: the agent sees orientations off by a fixed rotation of that angle an episode."""

    def __init__(
        self,
        num_envs: int = 8,
        *,
        seed: int = 0,
        horizon: int = 25,
        joints: int = 4,
        sigma: int = 0,
        belief_error: float = 0.0,
        drop: float = 0.0,
    ) -> None:
        terms = {"joints": joints, "goal": 6, "shape": 3, "pose": 9}
        if sigma:
            terms["sigma"] = sigma
        self.layout = ToyLayout(**terms)
        self.config = SimpleNamespace(reward=SimpleNamespace(rotation=1.0, rotation_clip=0.1, arrival=0.0))
        self.seed_, self.horizon, self.belief_error, self.drop = seed, horizon, belief_error, drop
        self.counter = np.zeros(num_envs, np.int64)
        self.gravity = 9.81
        self.R = np.tile(np.eye(3), (num_envs, 1, 1))
        self.goal = self.R.copy()
        self.error = self.R.copy()
        self.elapsed = np.zeros(num_envs, int)
        self.returns = np.zeros(num_envs)
        self.transition: ToyTransition | None = None
        box = spaces.Box(-np.inf, np.inf, (self.layout.size,), np.float32)
        super().__init__(num_envs, box, spaces.Box(-1.0, 1.0, (ACTIONS,), np.float32))

    def _begin(self, which) -> None:
        for env in which:
            rng = stream(self.seed_, "episode", int(env), int(self.counter[env]))
            self.counter[env] += 1
            self.R[env], self.goal[env] = rotations.random_rotations(rng, 2)
            axis = rng.standard_normal(3)
            self.error[env] = rotations.exp(axis / np.linalg.norm(axis) * self.belief_error)
        self.elapsed[which] = 0
        self.returns[which] = 0

    def _observe(self) -> np.ndarray:
        observation = np.zeros((self.num_envs, self.layout.size), np.float32)
        belief = self.error @ self.R
        observation[:, self.layout.slice("goal")] = rotations.to_6d(self.goal @ belief.transpose(0, 2, 1))
        observation[:, self.layout.slice("pose")] = np.concatenate(
            [np.zeros((self.num_envs, 3)), rotations.to_6d(belief)], 1
        )
        return observation

    def reset(self) -> np.ndarray:
        self._begin(np.arange(self.num_envs))
        return self._observe()

    def step_async(self, actions: np.ndarray) -> None:
        assert actions.shape == (self.num_envs, ACTIONS) and np.abs(actions).max() <= 1.0
        self.actions = actions.copy()

    def step_wait(self):
        before = self.R.copy()
        self.R = rotations.exp(SPEED * self.actions[:, :3].astype(np.float64)) @ self.R
        turned = rotations.geodesic(before, self.goal) - rotations.geodesic(self.R, self.goal)
        terms = {
            "rotation": np.minimum(turned, 0.1),
            "position": np.zeros(self.num_envs),
            "posture": -0.01 * np.square(self.actions[:, 3:]).sum(1),
        }
        reward = sum(terms.values())
        self.elapsed += 1
        self.returns += reward
        terminated = np.abs(self.actions[:, 3]) > 1.0 - self.drop
        truncated = ~terminated & (self.elapsed >= self.horizon)
        following = self._observe()
        theta = rotations.geodesic(self.R, self.goal)
        self.transition = ToyTransition(terms)
        done = terminated | truncated
        infos: list[dict] = [{} for _ in range(self.num_envs)]
        for env in np.flatnonzero(done):
            infos[env] = {
                "terminal_observation": following[env],
                "TimeLimit.truncated": bool(truncated[env]),
                "episode": {"r": float(self.returns[env]), "l": int(self.elapsed[env])},
                "success": bool(truncated[env] and theta[env] < 0.4),
                "theta": float(theta[env]),
                "drop": bool(terminated[env]),
                "fault": None,
                "variant": 0,
            }
        self._begin(np.flatnonzero(done))
        return self._observe(), reward.astype(np.float32), done, infos

    def set_gravity(self, g: float) -> None:
        self.gravity = g

    def get_state(self) -> dict[str, np.ndarray]:
        return {"counter": self.counter.copy()}

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        self.counter[:] = state["counter"]

    def close(self) -> None:
        pass

    def get_attr(self, attr_name, indices=None):
        return [getattr(self, attr_name) if attr_name != "render_mode" else None] * self.num_envs

    def set_attr(self, attr_name, value, indices=None) -> None:
        raise NotImplementedError

    def env_method(self, method_name, *args, indices=None, **kwargs):
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * self.num_envs
