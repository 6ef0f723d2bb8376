"""``tactile_kit/Reorient-v0``: the task as a single Gymnasium environment."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

import randomization
from tactile_kit.hand.kinematics import JOINTS
from tactile_kit.rotations import geodesic
from tactile_kit.simulation.episode import Status
from tactile_kit.task.actions import checked, for_simulator
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.core import Core
from tactile_kit.task.goals import EpisodeSpec, training_episodes
from tactile_kit.task.observation import Belief
from tactile_kit.task.reward import reward_terms


class ReorientEnv(gymnasium.Env):
    """Reorient an object in the hand (paper, section II); the policy is told the true pose (oracle).

    Observation: ``(D,) float32``, terms as in ``layout``. Action: ``(12,) float32`` in [-1, 1], target joint angles
    over the joint range. ``reset(seed=...)`` makes the coming episodes repeatable; ``reset(options={"episode": spec})``
    plays one :class:`EpisodeSpec`.

    Args:
        config: the task; single settings may be given by keyword instead or on top, for example
            ``gymnasium.make("tactile_kit/Reorient-v0", objects="cube")``.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(
        self, config: TaskConfig | None = None, render_mode: str | None = None, **settings: Any
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode = {render_mode!r}: allowed are None and 'rgb_array'")
        self.config = (config or TaskConfig()).changed(settings)
        self.render_mode = render_mode
        self.core = Core(self.config)
        self.layout = self.core.layout
        self.simulator = self.core.blueprint.build(visible=render_mode is not None)
        self.observation_space = spaces.Box(-np.inf, np.inf, (self.layout.size,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (JOINTS,), np.float32)
        self._z = np.zeros(144, np.float32)
        self._x, self._R, self._q = np.zeros(3), np.eye(3), np.zeros(JOINTS)
        self._episodes: Iterator[EpisodeSpec] | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray, dict[str, Any]]:
        """Start an episode; ``info`` holds its specification and the drawn physics."""
        super().reset(seed=seed)
        if seed is not None or self._episodes is None:
            start = (
                randomization.derive(seed, "training")
                if seed is not None
                else int(self.np_random.integers(2**62))
            )
            self._episodes = training_episodes(self.config, self.core.variants, 0, start)
        spec = (options or {}).get("episode")
        if spec is None:
            spec = next(self._episodes)
        elif not isinstance(spec, EpisodeSpec):
            raise TypeError(f"options['episode'] is a {type(spec).__name__}: allowed is an EpisodeSpec")
        self.spec_now = spec
        self.simulator.reset(spec.variant, spec.seed, self.config.gravity)
        self._read()
        self._x0 = self._x.copy()
        return self._observe(), {"episode_spec": spec, "randomization": self.simulator.physics}

    def step(self, action: NDArray) -> tuple[NDArray, float, bool, bool, dict[str, Any]]:
        """Play one action; 0.1 s. Raises ``ActionError`` where it has another shape, or is not finite."""
        left, x_before = self._left(), self._x.copy()
        action = checked(action, (JOINTS,), finite=True).astype(np.float64)
        status = self.simulator.step(for_simulator(self.config, action[None], self._z[None])[0])
        self._read()
        terminated = status in (Status.DROP, Status.FAULT)
        theta = self._left()
        terms = reward_terms(
            self.config.reward, left, theta, x_before, self._x, self._x0, self._q, terminated
        )
        info: dict[str, Any] = {
            "theta": float(theta),
            "reward_terms": {name: float(value) for name, value in terms.items()},
        }
        info["success"] = bool(status == Status.TIME and theta < self.config.success_angle)
        info["drop"], info["fault"] = status == Status.DROP, self.simulator.fault
        return self._observe(), float(sum(terms.values())), terminated, status == Status.TIME, info

    def render(self) -> NDArray[np.uint8] | None:
        """The scene as an RGB image ``(480, 480, 3)``, drawn by Bullet's software renderer."""
        if self.render_mode is None:
            return None
        from tactile_kit.simulation.camera import picture

        return picture(self.simulator.world.bullet)

    def __reduce__(self) -> tuple:
        """Copies and pickles are new environments, so only one that has not been reset can be copied or pickled."""
        if self._episodes is not None:
            raise TypeError(
                "an environment that has been reset can't be copied or pickled: its physics are Bullet's; make "
                "another, and play the episode again by reset(options={'episode': env.spec_now})"
            )
        return type(self), (self.config, self.render_mode)

    def close(self) -> None:
        """Disconnect from Bullet."""
        self.simulator.close()

    def _left(self) -> Any:
        """Angle to the goal, rad."""
        return geodesic(self._R, self.spec_now.goal)

    def _read(self) -> None:
        self.simulator.read(self._z, self._x, self._R, self._q)

    def _observe(self) -> NDArray[np.float32]:
        given = np.array([self.spec_now.given])
        return self.core.observer(self._z[None], self.spec_now.goal[None], self._belief(), given)[0]

    def _belief(self) -> Belief:
        return Belief(self._x[None].astype(np.float32), self._R[None].astype(np.float32))
