"""Many episodes of the compiled physics, behind the same arrays as the workers' Bullet (simulation/vector.py).

For training only: it plays the same episodes (objects, grasps, randomisation, ends), many times faster, with
simpler contacts. Whatever is measured of an agent is measured in Bullet.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from randomization import STANDARD_GRAVITY
from tactile_kit.hand import kinematics
from tactile_kit.shape import MeshTable
from tactile_kit.simulation.compiled.batch import JOINTS, Batch
from tactile_kit.simulation.compiled.draws import Draws
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
from tactile_kit.simulation.simulator import Simulator
from tactile_kit.simulation.worker import FIELDS, Blueprint
from tactile_kit.simulation.world import MAX_JOINT_SPEED

Array = NDArray[np.float64]


class CompiledSimulation:
    """``environments`` episodes at a time over ``threads`` threads; see :class:`VectorSimulation` for the use.

    Attributes:
        views: the arrays of ``FIELDS``, first axis environments.
        batch: the physics.
    """

    simulators: tuple[Simulator, ...] = ()
    faults: Path | None = None  # not written: its faults are no matter of Bullet

    def __init__(self, blueprint: Blueprint, meshes: MeshTable, environments: int, threads: int) -> None:
        self.batch = Batch(blueprint.config, blueprint.bodies, meshes, environments, threads)
        self.blueprint = blueprint
        self.views: dict[str, NDArray[Any]] = {
            n: np.zeros((environments, *shape), dtype) for n, (shape, dtype) in FIELDS.items()
        }
        self._all = np.arange(environments)
        self._active: NDArray[np.bool_] = np.ones(environments, bool)  # whose action is finite
        self._elapsed = np.zeros(environments, np.int64)
        self._draws = Draws(blueprint.preset, environments, blueprint.horizon)
        self._physics: list[Any] = [{}] * environments
        first, gravity = self._all[:1], STANDARD_GRAVITY
        heed(
            blueprint.config.engine,
            Episode.drawn(blueprint.preset, 0, gravity, blueprint.horizon, 1).physics,
            lambda physics: self.batch.set_physics(first, [physics]),
        )
        self._middle, self._range = MIDDLE.reshape(*JOINTS, 1), FULL_RANGE.reshape(*JOINTS, 1)

    # -- episodes -----------------------------------------------------------------------------------------------------
    def reset(self) -> None:
        """Start the next episode everywhere; states in ``z0, x0, R0, q0``."""
        self._start(self._all)

    def _start(self, which: NDArray[np.int64]) -> None:
        if not len(which):
            return
        views, bank = self.views, self.blueprint.bank
        variants = views["next_variant"][which]
        grasps = np.empty(len(which), np.int64)
        for number, (e, variant, seed, gravity) in enumerate(
            zip(
                which.tolist(),
                variants.tolist(),
                views["next_seed"][which].tolist(),
                views["next_gravity"][which].tolist(),
                strict=True,
            )
        ):
            blueprint = self.blueprint
            episode = Episode.drawn(blueprint.preset, seed, gravity, blueprint.horizon, bank.count(variant))
            self._physics[e] = episode.physics
            self._draws.begin(e, episode)
            grasps[number] = bank.start[variant] + episode.grasp
        joints = bank.joints[grasps][:, kinematics.DRIVEN_INDEX]
        self.batch.place(
            which, variants, joints, bank.command[grasps], bank.position[grasps], bank.rotation[grasps]
        )
        self.batch.set_physics(which, [self._physics[e] for e in which.tolist()])
        self._elapsed[which] = 0
        self._write(which, "0")

    # -- steps --------------------------------------------------------------------------------------------------------
    def step_async(self) -> None:
        """Begin a step with the actions in ``views``."""
        now, action = self.batch.now, self.views["action"].astype(np.float64)
        self._active = np.asarray(np.isfinite(action).all(axis=1))
        free = self._active & ~self._draws.sticky(self._elapsed)
        now.target[:] = np.where(free, self._aim(np.clip(action, -1.0, 1.0)), now.target)
        now.noise[:] = self._draws.noise(self._elapsed).T.reshape(now.noise.shape)
        for name, push in self._draws.pushes(self._elapsed).items():
            getattr(now, name)[:] = push.T
        self._elapsed += 1
        self.batch.start()

    def _aim(self, action: Array) -> Array:
        """Targets ``(4, 3, E)`` rad."""
        wanted = action.T.reshape(*JOINTS, -1)
        return self._middle + self._range * wanted

    def step_wait(self) -> dict[int, dict[str, Any]]:
        """Finish the step; returns ``fault``, ``steps`` and ``physics`` of episodes that ended, by environment."""
        self.batch.finish()
        fault = self._faults()
        if fault:
            self.batch.undo(np.array(list(fault)))  # the last state that means something
        self._write(self._all, "")
        status = self.views["status"]
        status[:] = np.where(self._elapsed >= self.blueprint.horizon, Status.TIME, Status.RUNNING)
        status[dropped(self.views["x"])] = Status.DROP
        status[list(fault)] = Status.FAULT
        over = np.flatnonzero(status != Status.RUNNING)
        ended = {
            e: {"fault": fault.get(e), "steps": int(self._elapsed[e]), "physics": self._physics[e]}
            for e in over.tolist()
        }
        self._start(over)
        return ended

    def _faults(self) -> dict[int, str]:
        """What went wrong, by environment; the limits are those of Bullet's simulator."""
        now = self.batch.now
        velocity = now.velocity.astype(np.float64)  # the square of a float32 may be infinite
        speed, spin = np.linalg.norm(velocity[:3], axis=0), np.linalg.norm(velocity[3:], axis=0)
        fastest = np.abs(now.dq).max(axis=(0, 1))
        moving = (speed <= MAX_SPEED) & (spin <= MAX_SPIN) & (fastest <= MAX_JOINT_SPEED)
        good = moving & (now.deepest >= -MAX_DEPTH) & np.isfinite(now.place).all(axis=0) & self._active
        reasons = {}
        for e in np.flatnonzero(~good).tolist():
            reasons[e] = f"object at {speed[e]:.3g} m/s and {spin[e]:.3g} rad/s, "
            reasons[e] += f"a finger {-1e3 * now.deepest[e]:.0f} mm inside it"
            if not self._active[e]:
                reasons[e] = f"action {self.views['action'][e]} is not finite"
        return reasons

    def _write(self, which: NDArray[np.int64], suffix: str) -> None:
        """States of the environments ``which`` to the views whose names end with ``suffix``."""
        views, now = self.views, self.batch.now
        for name in ("z", "q"):
            rows = getattr(now, name)[..., which]
            views[name + suffix][which] = rows.reshape(-1, len(which)).T
        views["x" + suffix][which], views["R" + suffix][which] = self.batch.pose(which)

    def close(self) -> None:
        """End the threads."""
        self.batch.close()
