"""One environment's episodes: physics drawn from the episode's seed, a grasp to start from, an end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import randomization
from tactile_kit.hand import kinematics
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.config import SAMPLES, SimulationConfig
from tactile_kit.simulation.dump import STATE, Dump
from tactile_kit.simulation.episode import (
    FULL_RANGE,
    MAX_DEPTH,
    MAX_SPEED,
    MAX_SPIN,
    MIDDLE,
    Episode,
    Status,
    dropped,
    heed,
)
from tactile_kit.simulation.grasps import GraspBank
from tactile_kit.simulation.world import PhysicsFault
from tactile_kit.simulation.worlds import world_of


class Simulator:
    """A world that plays episodes.

    An episode ends in a fault where an action is not finite, or where the physics left the range in which it means
    anything: a state that is not finite, joints or an object of impossible speed, a finger deep inside the object.
    Then ``fault`` says what happened, the state stays the last good one, and ``dump`` holds the way there.

    Args:
        config: physics.
        bodies: one a variant.
        bank: grasps, one group a variant.
        preset: domain randomisation.
        horizon: control steps an episode.
        visible: make the object visible to pictures.
    """

    def __init__(
        self,
        config: SimulationConfig,
        bodies: Sequence[Body],
        bank: GraspBank,
        preset: randomization.Randomization,
        horizon: int,
        visible: bool = False,
    ) -> None:
        self.world = world_of(config, visible)
        self.bodies, self.bank, self.preset, self.horizon = bodies, bank, preset, horizon
        self.elapsed = 0
        self.fault: str | None = None
        self.start: tuple[int, int, float] = (0, 0, 0.0)  # variant, seed and gravity of the episode
        self.actions: list[NDArray] = []  # of the episode
        self._interval: dict[str, int] = {}  # number of the present interval of each term drawn now and then
        self._heeds = False  # whether the engine takes all that the preset draws: seen in the first episode

    def reset(self, variant: int, seed: int, gravity: float) -> None:
        """Start an episode: everything random comes from ``seed``; ``gravity`` in m/s^2.

        Raises EpisodeError where the preset draws what this engine ignores.
        """
        world, self.start, self.actions = self.world, (variant, seed, gravity), []
        self.episode = Episode.drawn(self.preset, seed, gravity, self.horizon, self.bank.count(variant))
        self.physics: Mapping[str, Any] = self.episode.physics
        take = partial(world.load, self.bodies[variant])
        if self._heeds:
            take(self.physics)
        else:
            heed(world.config.engine, self.physics, take)
            self._heeds = True
        grasp = self.bank.grasp(variant, self.episode.grasp)
        world.place(grasp)
        self._target = grasp.command.copy()
        self.elapsed, self.fault, self._interval = 0, None, {}
        self.initial_position = world.position.copy()

    def step(self, action: NDArray) -> Status:
        """Play one action ``(12,)`` in [-1, 1]."""
        world, number = self.world, self.elapsed
        self.elapsed += 1
        self.actions.append(np.array(action, dtype=np.float64))
        if not np.isfinite(action).all():
            self.fault = f"action {action} is not finite"
            return Status.FAULT
        sticky = self.episode.sticky
        if sticky is None or not sticky[number]:
            action = np.clip(action, -1.0, 1.0)
            self._target = MIDDLE + FULL_RANGE * action
        self._disturb(number)
        noise = self.noise(number)
        before = world.q.copy(), world.e.copy(), world.joints, world.position, world.rotation
        try:
            world.step(self._target, noise)
            self._check()
        except PhysicsFault as error:
            # the last state that means something
            world.q, world.e, world.joints, world.position, world.rotation = before
            self.fault = str(error)
            return Status.FAULT
        if dropped(world.position):
            return Status.DROP
        return Status.TIME if self.elapsed >= self.horizon else Status.RUNNING

    @property
    def target(self) -> NDArray:
        """Joint angles ``(12,)`` rad that the last action asked for, before the command filter."""
        return self._target

    def _check(self) -> None:
        """Raises PhysicsFault where the object is ejected or a finger is inside of it."""
        world = self.world
        speed, turning = world.pace()
        if not (speed <= MAX_SPEED and turning <= MAX_SPIN):
            raise PhysicsFault(f"object at {speed:.3g} m/s and {turning:.3g} rad/s")
        if (depth := world.overlap()) > MAX_DEPTH:
            raise PhysicsFault(f"a finger {1e3 * depth:.0f} mm inside the object")

    def dump(self) -> Dump:
        """The present episode so far, to be written and played again (see ``tactile_kit.simulation.dump``)."""
        variant, seed, gravity = self.start
        start = {
            "variant": variant,
            "seed": seed,
            "gravity": gravity,
            "body": self.bodies[variant].name,
            "horizon": self.horizon,
            "config": self.world.config.model_dump(),
        }
        return Dump(
            self.fault or "",
            start,
            np.array(self.actions, dtype=np.float64).reshape(-1, kinematics.JOINTS),
            {name: np.asarray(value, dtype=np.float64) for name, value in self.physics.items()},
            {name: np.array(getattr(self.world, name)) for name in STATE},
        )

    def noise(self, number: int) -> NDArray | None:
        """Measurement noise ``(6, 12)`` rad of control step ``number``; None where there is none (any more)."""
        rows = self.episode.noise
        return rows[number] if rows is not None and number < self.horizon else None

    def _disturb(self, number: int) -> None:
        interval = self.episode.pushed(number)
        if interval == self._interval:
            return
        self._interval = interval
        values = {name: self.episode.pushes[name][at] for name, at in interval.items()}
        self.world.disturb(values.get("force", np.zeros(3)), values.get("torque", np.zeros(3)))

    def read(self, z: NDArray, x: NDArray, R: NDArray, q: NDArray) -> None:
        """Write the state: ``z (144,)``, ``x (3,)``, ``R (3, 3)``, true driven joints ``q (12,)``."""
        world = self.world
        z.reshape(SAMPLES, 2, kinematics.JOINTS)[:, 0] = world.q
        z.reshape(SAMPLES, 2, kinematics.JOINTS)[:, 1] = world.e
        x[:], R[:], q[:] = world.position, world.rotation, world.joints[kinematics.DRIVEN_INDEX]

    def close(self) -> None:
        """Free the physics."""
        self.world.close()
