"""Many hands with an object each, stepped together by the compiled physics; knows nothing of episodes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand import kinematics
from tactile_kit.hand.controller import TORQUE_LIMIT, damping_matrices, gravity_torques
from tactile_kit.rotations import from_quaternion, to_quaternion
from tactile_kit.shape import MeshTable
from tactile_kit.simulation.bodies import MIN_MASS, Body
from tactile_kit.simulation.compiled import kernel
from tactile_kit.simulation.compiled.contacts import NODES, PAIRS, SCRATCH
from tactile_kit.simulation.compiled.lanes import LANES
from tactile_kit.simulation.compiled.rows import FINGERS, FIRST_WRITTEN, ROWS, SHAPES, SIZES, Quantities, at
from tactile_kit.simulation.compiled.tables import distance_grids, hand_tables
from tactile_kit.simulation.config import SimulationConfig

Array = NDArray[Any]
JOINTS = (kinematics.FINGERS, kinematics.DRIVEN)
ITERATIONS = 20  # at most: rows that begin with the last step's impulses need fewer than Bullet's


class Batch:
    """``environments`` hands with an object each, for 0.1 s a :meth:`step`.

    An environment's motion depends on its own columns only, to the bit: not on the others, their order, their number
    or the number of threads. What is not finite stays in its own.

    Attributes:
        now: views ``(*shape, E) float32`` of everything by name (``rows.SHAPES`` has shapes and units): physics and
            state to read and to write between steps, ``now.target`` to write before a step, ``now.z`` and
            ``now.deepest`` to read after it.
        grids: distances around the objects.
        variant: the present object of each environment, ``(E,)``; written by :meth:`place`.

    Raises:
        ValueError: fewer than one environment.
    """

    def __init__(
        self,
        config: SimulationConfig,
        bodies: Sequence[Body],
        meshes: MeshTable,
        environments: int,
        threads: int = 1,
    ) -> None:
        if environments < 1:
            raise ValueError(f"num_envs = {environments}: allowed are 1 and more")
        self.config, self.count = config, environments
        blocks = -(-environments // LANES)
        self._table = np.zeros((ROWS, blocks * LANES), np.float32)
        everywhere = Quantities(
            *(
                self._table[first : first + SIZES[name]].reshape(*SHAPES[name], -1)
                for name, first in zip(SHAPES, at, strict=True)
            )
        )
        # what has no object yet, and lanes past the last environment, hover far from it
        everywhere.mass[:] = everywhere.moments[:] = everywhere.cells[:] = everywhere.quaternion[3] = 1.0
        everywhere.place[2] = 2.0
        self.now = Quantities(*(view[..., :environments] for view in everywhere))
        self.variant = np.zeros(environments, np.int64)
        self.grids = distance_grids(bodies, meshes)
        self._flat = self.grids.nodes.reshape(-1)
        self._nodes = np.zeros(blocks * LANES, np.int64)
        self._masses, self._coms = (
            np.array([body.mass for body in bodies]),
            np.stack([body.com for body in bodies]),
        )
        self._moments = np.stack([body.moments for body in bodies])
        self._axes = np.stack([body.axes for body in bodies])
        bounds = np.linspace(0, blocks, max(min(threads, blocks), 1) + 1).astype(int).tolist()
        self._parts = [(first, last, *_room()) for first, last in pairwise(bounds)]
        self._pool = ThreadPoolExecutor(len(self._parts))
        self._running: list[Future] = []
        self._kept = self._table[FIRST_WRITTEN:].copy()

    def place(
        self, which: Array, variant: Array, joints: Array, command: Array, position: Array, rotation: Array
    ) -> None:
        """Put objects into hands, at rest; what was measured last is what would be now, without noise.

        Args:
            which: environments ``(n,)``.
            variant: their objects, ``(n,)``.
            joints: driven joint angles ``(n, 12)`` rad.
            command: filtered command and target ``(n, 12)`` rad.
            position: of the object's canonical frame, ``(n, 3)`` m, world frame.
            rotation: of it, ``(n, 3, 3)``.

        Raises:
            ValueError: there is no such object.
        """
        if np.any((variant < 0) | (variant >= len(self._masses))):
            raise ValueError(f"variant = {variant}: allowed are 0 to {len(self._masses) - 1}")
        now, axes = self.now, self._axes[variant]
        self.variant[which], self._nodes[which] = variant, variant * NODES**3
        centre = position + (rotation @ self._coms[variant][..., None])[..., 0]
        now.place[:, which] = centre.T
        now.quaternion[:, which] = to_quaternion(rotation @ axes).T
        now.velocity[:, which] = now.dq[..., which] = now.memory[..., which] = now.noise[..., which] = 0.0
        now.force[:, which] = now.torque[:, which] = 0.0
        now.q[..., which] = joints.T.reshape(*JOINTS, -1)
        now.filtered[..., which] = now.target[..., which] = command.T.reshape(*JOINTS, -1)
        now.origin[:, which], now.cells[:, which] = (
            self.grids.first[variant].T,
            1.0 / self.grids.spacing[variant].T,
        )

    def set_physics(self, which: Array, physics: Sequence[Mapping[str, Any]]) -> None:
        """Physics of the environments ``which (n,)`` from now on, after :meth:`place`; as ``randomization`` names them.

        The controller carries the fingers' weight under each one's gravity. Measurements become those without noise.
        """
        now, config = self.now, self.config

        def drawn(name: str) -> Array:
            return np.array([one[name] for one in physics], np.float64)

        kp, series, gravity = drawn("kp"), drawn("series_stiffness"), drawn("gravity")
        ratio = series / (kp + series)
        stiffness, variant = kp * ratio, self.variant[which]
        mass = np.maximum(self._masses[variant] + drawn("object_mass_offset"), MIN_MASS)
        now.mass[which], now.gravity[which], now.stiffness[which] = mass, gravity, stiffness
        now.moments[:, which] = (self._moments[variant] * mass[:, None]).T
        for name, of in (("tip", "tip_friction"), ("link", "link_friction"), ("spin", "spinning_friction")):
            getattr(now, f"{name}_friction")[which] = drawn(of)
        now.limit[which], now.give[which] = TORQUE_LIMIT / stiffness, 1.0 - ratio
        damping = damping_matrices(drawn("kd") * ratio, stiffness, config.time_step)
        now.damping[..., which] = np.moveaxis(damping, 0, -1)
        weightless = gravity_torques(1.0).reshape(FINGERS, 4) @ kinematics.TENDON
        now.feedforward[..., which] = weightless[..., None] * gravity
        now.stick[..., which] = drawn("stick_friction").T.reshape(*JOINTS, -1)
        now.offset[..., which] = drawn("joint_offset").T.reshape(*JOINTS, -1)
        now.calm[which] = [math.exp(-config.drag_under(g) * config.time_step) for g in gravity.tolist()]
        self._measure(which)

    def _measure(self, which: Array) -> None:
        now = self.now
        q, filtered, offset = now.q[..., which], now.filtered[..., which], now.offset[..., which]
        limit = now.limit[which]
        angle = q + now.give[which] * np.clip(filtered - offset - q, -limit, limit) + offset
        now.z[:, 0, ..., which] = np.moveaxis(angle, -1, 0)[:, None]
        now.z[:, 1, ..., which] = np.moveaxis(filtered - angle, -1, 0)[:, None]

    def step(self) -> None:
        """0.1 s of all environments."""
        self.start()
        self.finish()

    def start(self) -> None:
        """Begin a step; nothing of ``now`` may be touched before :meth:`finish`."""
        self.keep()
        self._running = [self._pool.submit(part) for part in self.parts()]

    def finish(self) -> None:
        """End the step that was begun."""
        for future in self._running:
            future.result()
        self._running = []

    def parts(self) -> list[Callable[[], None]]:
        """What a step calls, one a thread."""
        config = self.config
        step, keep = config.time_step, math.exp(-config.time_step / config.filter_time_constant)
        iterations = min(ITERATIONS, config.solver_iterations)
        given = (step, config.steps_per_sample, iterations, keep, hand_tables(), self._flat, self._nodes)
        return [
            partial(kernel.control_step, first, last, *given, self._table.reshape(-1), *room)
            for first, last, *room in self._parts
        ]

    def keep(self) -> None:
        """Remember the present state, for :meth:`undo`."""
        np.copyto(self._kept, self._table[FIRST_WRITTEN:])

    def undo(self, which: Array) -> None:
        """Take the environments ``which (n,)`` back to the state kept, which is that before the last step."""
        self._table[FIRST_WRITTEN:, which] = self._kept[:, which]

    def pose(self, which: Array) -> tuple[Array, Array]:
        """Position ``(n, 3)`` m and rotation ``(n, 3, 3)`` of the objects' canonical frames, float64, world frame."""
        variant, quaternion = self.variant[which], self.now.quaternion[:, which].T.astype(np.float64)
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        rotation = from_quaternion(quaternion) @ self._axes[variant].transpose(0, 2, 1)
        position = self.now.place[:, which].T - (rotation @ self._coms[variant][..., None])[..., 0]
        return position, rotation

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown()


def _room() -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """What the kernel works in, on the border of a vector: half of the reads would touch two cache lines otherwise."""
    room = np.zeros((SCRATCH + 1) * LANES, np.float32)
    skip = -room.ctypes.data // room.itemsize % LANES
    return room[skip : skip + SCRATCH * LANES], np.zeros(FINGERS + PAIRS, np.int64)
