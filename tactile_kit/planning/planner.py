"""A planner over finger gaits: a privileged agent that needs no training.

Predictive sampling (Howell et al. 2022) over moves instead of joint angles: whenever a move ends, dozens of plans of
two random moves are played in a copy of the simulator from the very state the episode is in. The best are played again
with the command shaken, so that none is chosen that only just holds, and the first move of the winner is carried out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeInt, PositiveInt

from tactile_kit.hand.kinematics import DRIVEN_INDEX, JOINTS, MEAN_GRASP
from tactile_kit.planning.gait import Gait, Move, random_move
from tactile_kit.planning.laws import CENTRE
from tactile_kit.settings import Settings
from tactile_kit.simulation.episode import FULL_RANGE, MIDDLE, dropped
from tactile_kit.simulation.simulator import Simulator
from tactile_kit.simulation.world import PhysicsFault, Snapshot, World

Array = NDArray[np.float64]
Plan = tuple[Move, ...]

REST = (Move(rest=True),)
LOST = 0.07  # m from the centre of the hand: as good as dropped
NEAR = 0.008  # m from it that cost nothing


class PlannerConfig(Settings):
    """How the planner searches and what it looks for."""

    plans: PositiveInt = Field(40, description="Plans tried at the end of every move.")
    plans_at_goal: PositiveInt = Field(24, description="Plans tried once the goal is reached.")
    horizon: PositiveInt = Field(22, description="Actions a plan is played for, 0.1 s each.")
    finalists: PositiveInt = Field(4, description="Plans that are played again with a shaken command.")
    repeats: NonNegativeInt = Field(2, description="How often each.")
    shake: float = Field(0.03, ge=0, description="Standard deviation of the shaken command, rad.")
    reached: float = Field(0.3, ge=0, description="Angle to the goal at which resting is preferred, rad.")
    midway: float = Field(0.3, ge=0, description="Weight of the angle at half of the horizon.")
    position: float = Field(6.0, ge=0, description="Price of a metre from the centre of the hand.")
    posture: float = Field(0.1, ge=0, description="Price of joint angles far from the mean grasp, 1/rad^4.")
    speed: float = Field(1.5, ge=0, description="Price of the object's final speed, s/m.")
    drop: float = Field(4.0, ge=0, description="Price of losing the object.")
    steps_per_second: PositiveInt | None = Field(
        None,
        multiple_of=60,
        description="Physics steps a second of the planner's own world; by default as many as the simulator's.",
    )


def angle_between(first: Array, second: Array) -> float:
    """Geodesic angle (rad) of two rotations ``(3, 3)``; for single ones ``rotations.geodesic`` costs too much."""
    return math.acos(min(1.0, max(-1.0, 0.5 * (float(np.vdot(first, second)) - 1.0))))


class Rollout(NamedTuple):
    """How a plan went: its score, and whether the object was lost."""

    score: float
    failed: bool


class Planner:
    """Plans for one simulator, in a world of its own with the same object and physics (steps may be coarser).

    Args:
        simulator: whose episodes are planned for. The planner reads its full state, but foresees no forces, and of
            sticky actions only how frequent they are.
        config: settings.
    """

    def __init__(self, simulator: Simulator, config: PlannerConfig | None = None) -> None:
        self.simulator, self.config = simulator, config or PlannerConfig()
        step, physics = self.config.steps_per_second, simulator.world.config
        self.world = World(physics if step is None else physics.changed({"steps_per_second": step}))

    def start(self, seed: int) -> None:
        """Begin an episode: the simulator has just been reset. Everything random comes from ``seed``."""
        real = self.simulator.world
        self.rng = np.random.default_rng(seed)
        self.world.load(real.body, real.physics)
        self.gait = Gait(real.config.filter_time_constant)
        self._next: Plan = ()

    def act(self, goal: Array) -> Array:
        """The next action ``(12,)`` in [-1, 1] towards the goal orientation ``(3, 3)``."""
        if self.gait.over:
            move, *left = self._choose(goal)
            self.gait.start(move)
            self._next = tuple(left)
        return self.gait.action(self.simulator.world, goal)

    def _choose(self, goal: Array) -> Plan:
        config, moment = self.config, self.simulator.world.snapshot()
        angle = angle_between(moment.rotation, goal)
        plans = self._plans(angle)
        preference = np.zeros(len(plans))
        preference[0] = 0.2 if angle < config.reached else -0.05  # to rest is easy, and leads nowhere
        scores = preference + [self.play(moment, plan, goal).score for plan in plans]
        finalists = np.argsort(-scores, kind="stable")[: config.finalists].tolist()
        for index in finalists:
            shaken = [
                replace(moment, command=moment.command + self.rng.normal(0.0, config.shake, JOINTS))
                for _ in range(config.repeats)
            ]
            scores[index] += sum(
                self.play(other, plans[index], goal, self._sticky()).score for other in shaken
            )
        return plans[max(finalists, key=lambda index: scores[index])]

    def _plans(self, angle: float) -> list[Plan]:
        """Resting, turning on, standing still, what is left of the last plan, and random plans."""
        horizon = self.config.horizon
        plans: list[Plan] = [
            REST * (horizon // 3 + 1),
            (Move(),),
            (Move(turn=0.05),),
            (Move(turn=0.0, steps=horizon),),
        ]
        if self._next:
            plans.append(self._next)
        count = self.config.plans if angle > 0.2 else self.config.plans_at_goal
        plans += [(random_move(self.rng), random_move(self.rng)) for _ in range(count - len(plans))]
        return plans

    def _sticky(self) -> NDArray[np.bool_]:
        """Which actions of a shaken roll-out fail to arrive, ``(horizon,)``: as often as in the episode."""
        term = self.simulator.preset.terms["sticky_action"]
        drawn = term.draw_many(int(self.rng.integers(2**62)), self.config.horizon)
        return np.asarray(drawn, bool).reshape(self.config.horizon)

    def play(
        self, moment: Snapshot, plan: Sequence[Move], goal: Array, sticky: NDArray[np.bool_] | None = None
    ) -> Rollout:
        """Play ``plan`` from ``moment`` in the planner's own world, and turn on with all fingers when it is over.

        ``sticky (horizon,)``: actions that fail to arrive; without it every action arrives.
        """
        config, world, simulator = self.config, self.world, self.simulator
        world.restore(moment)
        gait, moves = self.gait.fresh(), iter(plan)
        gait.start(next(moves))
        midway = angle = angle_between(world.rotation, goal)
        target = simulator.target
        for number in range(config.horizon):
            if gait.over:
                gait.start(next(moves, Move()))
            action = gait.action(world, goal)
            if sticky is None or not sticky[number]:
                target = MIDDLE + FULL_RANGE * action
            try:
                world.step(target, simulator.noise(simulator.elapsed + number))
            except PhysicsFault:
                world.load(simulator.world.body, simulator.world.physics)
                return Rollout(-2.0 * config.drop, True)
            if dropped(world.position) or _off(world) > LOST:
                return Rollout(0.05 * number - config.drop, True)  # later is better
            angle = angle_between(world.rotation, goal)
            if number == config.horizon // 2:
                midway = angle
        velocity, _ = world.bullet.getBaseVelocity(world.object)
        score = -angle - config.midway * midway - config.position * max(0.0, _off(world) - NEAR)
        score -= config.posture * float(((world.joints[DRIVEN_INDEX] - MEAN_GRASP) ** 4).sum())
        return Rollout(score - config.speed * math.hypot(*velocity), False)

    def close(self) -> None:
        """Disconnect the planner's own world."""
        self.world.close()


def _off(world: World) -> float:
    return float(np.linalg.norm(world.position - CENTRE))
