"""Predictive sampling in the simulator itself (Howell et al. 2022): a privileged agent that needs no training.

Before every action the planner plays some dozens of action sequences of about a second from the very state the episode
is in, each a few knots scattered around the last best sequence, and takes the first action of the one with the highest
reward. Many sequences move one or two fingers only: that is how it finds to let go with one while others hold, which
noise on all joints does not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat, PositiveInt

from tactile_kit.hand.kinematics import DRIVEN, DRIVEN_INDEX, FINGERS, JOINTS, MEAN_GRASP
from tactile_kit.simulation.simulator import FULL_RANGE, MIDDLE, Simulator, dropped
from tactile_kit.simulation.world import PhysicsFault, Snapshot, World
from tactile_kit.task.config import RewardConfig, Settings

Array = NDArray[np.float64]


class PlannerConfig(Settings):
    """How the planner searches."""

    samples: PositiveInt = Field(
        40, description="Sequences tried before each action, the last best one among them."
    )
    horizon: PositiveInt = Field(10, description="Actions a sequence, 0.1 s each.")
    knots: PositiveInt = Field(5, description="Knots a sequence; actions between them are interpolated.")
    spread: PositiveFloat = Field(
        0.3, description="Standard deviation of the knots, in units of half the joint range."
    )
    few_fingers: float = Field(
        0.6, ge=0, le=1, description="Share of the sequences that move one or two fingers only."
    )
    drop: float = Field(3.0, ge=0, description="Price of a drop in a sequence.")
    angle: float = Field(1.0, ge=0, description="Weight of the whole angle gained over a sequence, 1/rad.")


def angle_between(first: Array, second: Array) -> float:
    """Geodesic angle (rad) of two rotations ``(3, 3)``; for single ones ``rotations.geodesic`` costs too much."""
    return math.acos(min(1.0, max(-1.0, 0.5 * (float(np.vdot(first, second)) - 1.0))))


class State(NamedTuple):
    """What an agent is told of a moment: ``z (144,)``, ``x (3,)``, ``R (3, 3)``, driven joints ``q (12,)``."""

    z: NDArray[np.float32]
    x: Array
    R: Array
    q: Array

    @classmethod
    def of(cls, world: World) -> State:
        """The world's present state."""
        z = np.stack([world.q, world.e], axis=1).astype(np.float32).ravel()
        return cls(z, world.position, world.rotation, world.joints[DRIVEN_INDEX])


class Rollout(NamedTuple):
    """A sequence played: ``N + 1`` states, actions ``(N, 12)``, its score, whether it ended in a drop or fault."""

    states: list[State]
    actions: Array
    score: float
    failed: bool


class Planner:
    """Plans for one simulator, in a world of its own with the same object and physics.

    Args:
        simulator: whose episodes are planned for. The planner reads its full state, but does not foresee sticky
            actions and forces; measurement noise is in what it records and moves nothing.
        config: settings.
        reward: the reward's coefficients (paper, section II-E).

    Attributes:
        rollouts: everything played for the last action.
    """

    def __init__(
        self, simulator: Simulator, config: PlannerConfig | None = None, reward: RewardConfig | None = None
    ) -> None:
        self.simulator, self.config, self.reward = (
            simulator,
            config or PlannerConfig(),
            reward or RewardConfig(),
        )
        self.world = World(simulator.world.config)
        config = self.config
        places = np.linspace(0, config.knots - 1, config.horizon)
        below = np.minimum(places.astype(int), max(config.knots - 2, 0))
        part = places - below
        self._mix = np.zeros((config.horizon, config.knots))
        self._mix[np.arange(config.horizon), below] = 1 - part
        if config.knots > 1:
            self._mix[np.arange(config.horizon), below + 1] += part

    def start(self, seed: int) -> None:
        """Begin an episode: the simulator has just been reset. Everything random comes from ``seed``."""
        real = self.simulator.world
        self.rng = np.random.default_rng(seed)
        self.world.load(real.body, real.physics)
        self.origin = self.simulator.initial_position
        action = (real.command - MIDDLE) / FULL_RANGE
        self.best = np.tile(action, (self.config.horizon, 1))

    def act(self, goal: Array) -> Array:
        """The next action ``(12,)`` in [-1, 1] towards the goal orientation ``(3, 3)``."""
        moment = self.simulator.world.snapshot()
        candidates = self._candidates()
        self.rollouts = [self.roll_out(moment, sequence, goal) for sequence in candidates]
        self.best = candidates[int(np.argmax([rollout.score for rollout in self.rollouts]))]
        action = self.best[0].copy()
        self.best = np.concatenate([self.best[1:], self.best[-1:]])
        return action

    def _candidates(self) -> Array:
        """The last best sequence and variations of it, ``(samples, horizon, 12)``."""
        config, rng = self.config, self.rng
        noise = rng.normal(0.0, config.spread, (config.samples, config.knots, FINGERS, DRIVEN))
        few = rng.random(config.samples) < config.few_fingers
        order = rng.random((config.samples, FINGERS)).argsort(axis=1)
        moved = np.where(few, rng.integers(1, 3, config.samples), FINGERS)
        noise *= (order < moved[:, None])[:, None, :, None]
        noise *= rng.uniform(0.2, 1.0, (config.samples, 1, 1, 1))  # small corrections and large ones
        noise[0] = 0.0
        sequences = self.best + np.einsum(
            "hk,skj->shj", self._mix, noise.reshape(config.samples, config.knots, JOINTS)
        )
        return np.clip(sequences, -1.0, 1.0)

    def roll_out(self, moment: Snapshot, sequence: Array, goal: Array) -> Rollout:
        """Play ``sequence (H, 12)`` from ``moment`` in the planner's own world."""
        world, reward, simulator = self.world, self.reward, self.simulator
        world.restore(moment)
        states = [State.of(simulator.world)]
        total, before = 0.0, angle_between(world.rotation, goal)
        first, away = before, float(np.linalg.norm(world.position - self.origin))
        failed = False
        for number, action in enumerate(sequence):
            try:
                world.step(MIDDLE + FULL_RANGE * action, simulator.noise(simulator.elapsed + number))
            except PhysicsFault:
                world.load(simulator.world.body, simulator.world.physics)
                failed = True
                break
            states.append(State.of(world))
            theta = angle_between(world.rotation, goal)
            distance = float(np.linalg.norm(world.position - self.origin))
            total += reward.rotation * min(before - theta, reward.rotation_clip) - reward.position * (
                distance - away
            )
            total -= reward.posture * float(((world.joints[DRIVEN_INDEX] - MEAN_GRASP) ** 4).sum())
            before, away = theta, distance
            if dropped(world.position):
                failed = True
                break
        total += -self.config.drop if failed else self.config.angle * (first - before)
        return Rollout(states, sequence[: len(states) - 1], total, failed and len(states) > 1)

    def close(self) -> None:
        """Disconnect the planner's own world."""
        self.world.close()
