"""Many episodes of the compiled physics, behind the same arrays as the workers' Bullet (simulation/vector.py).

For training only: it plays the same episodes (objects, grasps, randomisation, ends), some twenty times faster, with
simpler contacts. Whatever is measured of an agent is measured in Bullet.
"""

from __future__ import annotations

import functools
import math
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import randomization
from tactile_kit.hand import kinematics
from tactile_kit.hand.controller import TORQUE_LIMIT, Impedance, ImpedanceController
from tactile_kit.shape import MeshTable
from tactile_kit.simulation.compiled import kernel as k
from tactile_kit.simulation.compiled.tables import distance_grids, hand_tables
from tactile_kit.simulation.config import CONTROL_RATE, SAMPLES
from tactile_kit.simulation.simulator import (
    FULL_RANGE,
    MAX_DEPTH,
    MAX_SPEED,
    MAX_SPIN,
    MIDDLE,
    RELATIVE_STEP,
    Simulator,
    Status,
    dropped,
)
from tactile_kit.simulation.support import drag_of, stiffness_of
from tactile_kit.simulation.worker import FIELDS, Blueprint
from tactile_kit.simulation.world import MAX_JOINT_SPEED
from tactile_kit.task.rotations import from_quaternion, to_quaternion

Array = NDArray[np.float64]
ITERATIONS = 20  # at most: rows that begin with the last step's impulses need fewer than Bullet's
FINGER = (kinematics.FINGERS, kinematics.DRIVEN)


@functools.lru_cache(4096)
def _controller(impedance: Impedance, step: float, gravity: float) -> tuple[Array, Array, float]:
    """Damping ``(4, 3, 3)``, feedforward ``(4, 3)`` and stiffness of the impedance controller."""
    law = ImpedanceController(impedance, step, gravity)
    return law.damping, law.feedforward, impedance.stiffness * impedance.ratio


class CompiledSimulation:
    """``environments`` episodes at a time over ``threads`` threads; see :class:`VectorSimulation` for the use.

    Attributes:
        views: the arrays of ``FIELDS``, first axis environments.
    """

    simulators: tuple[Simulator, ...] = ()
    faults: Path | None = None  # not written: its faults are no matter of Bullet

    def __init__(self, blueprint: Blueprint, meshes: MeshTable, environments: int, threads: int) -> None:
        if environments < 1:
            raise ValueError(f"num_envs = {environments}: allowed are 1 and more")
        self.blueprint, self._count = blueprint, environments
        self.views: dict[str, NDArray[Any]] = {
            n: np.zeros((environments, *shape), dtype) for n, (shape, dtype) in FIELDS.items()
        }
        self._grids: tuple[Any, ...] = distance_grids(blueprint.bodies, meshes)
        self._hand: Any = hand_tables()
        self._bounds = np.linspace(0, environments, max(threads, 1) + 1).astype(int)
        self._pool = ThreadPoolExecutor(max(threads, 1))
        self._running: list[Future] = []
        E, config = environments, blueprint.config
        self._keep = math.exp(-config.time_step / config.filter_time_constant)
        self._active: NDArray[np.bool_] = np.ones(E, bool)
        self._variant, self._elapsed = np.zeros(E, np.int64), np.zeros(E, np.int64)
        self._parameters, self._memory = np.zeros((E, k.PARAMETERS)), np.zeros((E, 4, k.BALLS, 4))
        self._damping = np.zeros((E, 4, 3, 3))
        self._feedforward, self._stick, self._offset, self._target, self._filtered, self._q, self._dq = (
            np.zeros((E, *FINGER)) for _ in range(7)
        )
        self._place, self._quaternion, self._velocity = np.zeros((E, 3)), np.zeros((E, 4)), np.zeros((E, 6))
        self._noise, self._z, self._deepest = (
            np.zeros((E, SAMPLES, *FINGER)), np.zeros((E, SAMPLES, 2, *FINGER)), np.zeros(E),
        )  # fmt: skip
        self._steps: list[dict[str, Array]] = [{}] * E
        self._intervals: list[dict[str, Array]] = [{}] * E
        self._physics: list[dict[str, Any]] = [{}] * E
        self._every = {n: t.interval for n, t in blueprint.preset.terms.items() if t.interval is not None}

    # -- episodes -----------------------------------------------------------------------------------------------------
    def reset(self) -> None:
        """Start the next episode everywhere; states in ``z0, x0, R0, q0``."""
        self._start(np.arange(self._count))

    def _start(self, which: NDArray[np.int64]) -> None:
        for e in which.tolist():
            self._begin(e)
        self._write(which, "0")

    def _begin(self, e: int) -> None:
        views, blueprint = self.views, self.blueprint
        variant, seed, gravity = (
            int(views["next_variant"][e]), int(views["next_seed"][e]), float(views["next_gravity"][e])
        )  # fmt: skip
        preset, horizon, config = blueprint.preset, blueprint.horizon, blueprint.config
        physics = {**preset.draw("episode", seed), "gravity": gravity}
        self._steps[e] = preset.draw_steps(seed, horizon * SAMPLES)
        self._intervals[e] = preset.draw_intervals(seed, horizon / CONTROL_RATE)
        self._physics[e], self._variant[e], self._elapsed[e] = physics, variant, 0
        body = blueprint.bodies[variant]
        number = int(randomization.stream(seed, "grasp").integers(blueprint.bank.count(variant)))
        grasp = blueprint.bank.grasp(variant, number)
        place, rotation = body.to_bullet(grasp.position, grasp.rotation)
        self._place[e], self._quaternion[e] = place, to_quaternion(rotation)
        self._velocity[e], self._dq[e], self._memory[e], self._noise[e] = 0.0, 0.0, 0.0, 0.0
        self._q[e] = grasp.joints[kinematics.DRIVEN_INDEX].reshape(FINGER)
        self._filtered[e] = self._target[e] = grasp.command.reshape(FINGER)
        impedance = Impedance(physics["kp"], physics["kd"], physics["series_stiffness"])
        damping, feedforward, stiffness = _controller(impedance, config.time_step, gravity)
        self._damping[e], self._feedforward[e] = damping, feedforward
        self._stick[e] = np.asarray(physics["stick_friction"]).reshape(FINGER)
        self._offset[e] = np.asarray(physics["joint_offset"]).reshape(FINGER)
        mass = max(body.mass + float(physics["object_mass_offset"]), 1e-3)
        row = self._parameters[e]
        row[k.MASS], row[k.GRAVITY], row[k.STIFFNESS] = mass, gravity, stiffness
        row[k.TIP_FRICTION], row[k.LINK_FRICTION] = physics["tip_friction"], physics["link_friction"]
        row[k.SPIN_FRICTION] = physics["spinning_friction"]
        row[k.LIMIT], row[k.GIVE] = TORQUE_LIMIT / stiffness, 1.0 - impedance.ratio
        row[k.SUPPORT] = stiffness_of(config, gravity)
        row[k.KEEP] = math.exp(-drag_of(config, gravity) * config.time_step)
        row[k.FORCE : k.FORCE + 3] = row[k.TORQUE : k.TORQUE + 3] = 0.0
        row[k.MOMENTS : k.MOMENTS + 3], row[k.PLACE : k.PLACE + 3] = body.moments * mass, place
        k.measure(self._q[e], self._filtered[e], self._offset[e], row, self._noise[e, 0], self._z[e, 0])
        self._z[e, 1:] = self._z[e, 0]

    # -- steps --------------------------------------------------------------------------------------------------------
    def step_async(self) -> None:
        """Begin a step with the actions in ``views``."""
        action = self.views["action"].astype(np.float64)
        self._active = np.asarray(np.isfinite(action).all(axis=1))
        self._aim(np.clip(action, -1.0, 1.0))
        for e, steps in enumerate(self._steps):
            number = int(self._elapsed[e])
            if "joint_noise" in steps:
                rows = steps["joint_noise"][number * SAMPLES : (number + 1) * SAMPLES]
                self._noise[e] = rows.reshape(self._noise[e].shape)
            for name, at in (("force", k.FORCE), ("torque", k.TORQUE)):
                if name in self._intervals[e]:
                    interval = int(number / CONTROL_RATE / self._every[name] + 1e-9)
                    self._parameters[e, at : at + 3] = self._intervals[e][name][interval]
        self._elapsed += 1
        config = self.blueprint.config
        before = [a.copy() for a in (self._z, self._q, self._place, self._quaternion)]
        self._before = before
        given: tuple[Any, ...] = (
            self._active, config.time_step, config.steps_per_sample, min(ITERATIONS, config.solver_iterations),
            self._keep, self._hand, *self._grids, self._variant, self._parameters, self._damping, self._feedforward,
            self._stick, self._offset, self._noise, self._target, self._filtered, self._q, self._dq, self._place,
            self._quaternion, self._velocity, self._memory, self._z, self._deepest,
        )  # fmt: skip
        self._running = [
            self._pool.submit(k.control_step, first, last, *given)
            for first, last in pairwise(self._bounds.tolist())
        ]

    def _aim(self, action: Array) -> None:
        if self.blueprint.relative:
            wanted = self._z[:, -1, 0] + RELATIVE_STEP * action.reshape(-1, *FINGER)
            _, _, _, _, _, _, _, _, lower, upper = self._hand
            wanted = np.clip(wanted, lower, upper)
        else:
            wanted = (MIDDLE + FULL_RANGE * action).reshape(-1, *FINGER)
        free = self._active.copy()
        for e, steps in enumerate(self._steps):
            if "sticky_action" in steps and steps["sticky_action"][self._elapsed[e]]:
                free[e] = False
        self._target[free] = wanted[free]

    def step_wait(self) -> dict[int, dict[str, Any]]:
        """Finish the step; returns ``fault``, ``steps`` and ``physics`` of episodes that ended, by environment."""
        for future in self._running:
            future.result()
        self._running = []
        fault = self._faults()
        for e in fault:  # the last state that means something
            for array, old in zip(
                (self._z, self._q, self._place, self._quaternion), self._before, strict=True
            ):
                array[e] = old[e]
        everywhere = np.arange(self._count)
        self._write(everywhere, "")
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
        speed, spin = (
            np.linalg.norm(self._velocity[:, :3], axis=1),
            np.linalg.norm(self._velocity[:, 3:], axis=1),
        )
        fastest = np.abs(self._dq).max(axis=(1, 2))
        moving = (speed <= MAX_SPEED) & (spin <= MAX_SPIN) & (fastest <= MAX_JOINT_SPEED)
        good = moving & (self._deepest >= -MAX_DEPTH) & np.isfinite(self._place).all(axis=1) & self._active
        reasons = {}
        for e in np.flatnonzero(~good).tolist():
            reasons[e] = f"object at {speed[e]:.3g} m/s and {spin[e]:.3g} rad/s, "
            reasons[e] += f"a finger {-1e3 * self._deepest[e]:.0f} mm inside it"
            if not self._active[e]:
                reasons[e] = f"action {self.views['action'][e]} is not finite"
        return reasons

    def _write(self, which: NDArray[np.int64], suffix: str) -> None:
        """States of the environments ``which`` to the views whose names end with ``suffix``."""
        views = self.views
        if not len(which):
            return
        views["z" + suffix][which] = self._z[which].reshape(len(which), -1)
        views["q" + suffix][which] = self._q[which].reshape(len(which), -1)
        rotation = from_quaternion(self._quaternion[which])
        place = self._place[which]
        for variant in np.unique(self._variant[which]).tolist():
            body, own = self.blueprint.bodies[variant], np.flatnonzero(self._variant[which] == variant)
            turned = rotation[own] @ body.axes.T
            views["R" + suffix][which[own]] = turned
            views["x" + suffix][which[own]] = place[own] - turned @ body.com

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown()
