"""Many hands with an object each, stepped together by the compiled physics; knows nothing of episodes."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand import kinematics
from tactile_kit.hand.controller import TORQUE_LIMIT, Impedance, ImpedanceController
from tactile_kit.shape import MeshTable
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.compiled import kernel as k
from tactile_kit.simulation.compiled.engine import ITERATIONS
from tactile_kit.simulation.compiled.tables import distance_grids, hand_tables
from tactile_kit.simulation.config import SAMPLES, SimulationConfig
from tactile_kit.task.rotations import from_quaternion, to_quaternion

Array = NDArray[Any]
JOINTS = (kinematics.FINGERS, kinematics.DRIVEN)


class State(NamedTuple):
    """What moves, last axis hands: to read and to write between steps."""

    q: Array  # (4, 3, E) rad
    dq: Array  # (4, 3, E) rad/s
    filtered: Array  # (4, 3, E) rad, the filtered command
    target: Array  # (4, 3, E) rad, what it follows
    place: Array  # (3, E) m, the object's centre of mass
    quaternion: Array  # (4, E) of its principal axes, (x, y, z, w)
    velocity: Array  # (6, E) m/s, rad/s
    deepest: Array  # (E,) m, deepest gap of the last step; negative inside the object


class Batch:
    """``environments`` hands for 0.1 s a :meth:`step`, without noise, disturbance or support.

    A hand's motion does not depend on the others, their order or their number, to the bit.
    """

    def __init__(
        self, config: SimulationConfig, bodies: Sequence[Body], meshes: MeshTable, environments: int
    ) -> None:
        self.config, self._bodies, count = config, bodies, environments
        self._grids: tuple[Any, ...] = distance_grids(bodies, meshes)
        self._variant = np.zeros(count, np.int64)
        self._parameters, self._memory = np.zeros((count, k.PARAMETERS)), np.zeros((count, 4, k.BALLS, 4))
        self._damping = np.zeros((count, 4, 3, 3))
        self._feedforward, self._stick, self._offset = (np.zeros((count, *JOINTS)) for _ in range(3))
        self._noise, self._z = np.zeros((count, SAMPLES, *JOINTS)), np.zeros((count, SAMPLES, 2, *JOINTS))
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("q", "dq", "filtered", "target"), JOINTS)
        shapes |= {"place": (3,), "quaternion": (4,), "velocity": (6,), "deepest": ()}
        self._state = {name: np.zeros((count, *shapes[name])) for name in State._fields}
        self.now = State(*(np.moveaxis(self._state[name], 0, -1) for name in State._fields))

    def place(
        self, which: Array, variant: Array, joints: Array, command: Array, position: Array, rotation: Array
    ) -> None:
        """Put objects into hands, at rest.

        Args:
            which: hands ``(n,)``.
            variant: their objects, ``(n,)``.
            joints: driven joint angles ``(n, 12)`` rad.
            command: filtered command and target ``(n, 12)`` rad.
            position: of the object's canonical frame, ``(n, 3)`` m, world frame.
            rotation: of it, ``(n, 3, 3)``.
        """
        now = self.now
        self._variant[which] = variant
        for e, body, x, R in zip(which, (self._bodies[v] for v in variant), position, rotation, strict=True):
            centre, axes = body.to_bullet(x, R)
            now.place[:, e], now.quaternion[:, e] = centre, to_quaternion(axes)
        now.velocity[:, which] = now.dq[..., which] = 0.0
        self._memory[which] = 0.0
        now.q[..., which] = joints.T.reshape(*JOINTS, -1)
        now.filtered[..., which] = now.target[..., which] = command.T.reshape(*JOINTS, -1)

    def set_physics(self, which: Array, physics: Sequence[Mapping[str, Any]]) -> None:
        """Physics of the hands ``which (n,)`` from now on, after :meth:`place`; as ``randomization`` names them."""
        for e, drawn in zip(which, physics, strict=True):
            body, row = self._bodies[self._variant[e]], self._parameters[e]
            impedance = Impedance(drawn["kp"], drawn["kd"], drawn["series_stiffness"])
            stiffness = impedance.stiffness * impedance.ratio
            mass = max(body.mass + float(drawn["object_mass_offset"]), 1e-3)
            row[k.MASS], row[k.GRAVITY], row[k.STIFFNESS] = mass, drawn["gravity"], stiffness
            row[k.TIP_FRICTION], row[k.LINK_FRICTION] = drawn["tip_friction"], drawn["link_friction"]
            row[k.SPIN_FRICTION], row[k.KEEP] = drawn["spinning_friction"], 1.0
            row[k.LIMIT], row[k.GIVE] = TORQUE_LIMIT / stiffness, 1.0 - impedance.ratio
            row[k.MOMENTS : k.MOMENTS + 3] = body.moments * mass
            self._damping[e], self._feedforward[e] = _law(
                impedance, self.config.time_step, float(drawn["gravity"])
            )
            self._stick[e] = np.asarray(drawn["stick_friction"]).reshape(JOINTS)
            self._offset[e] = np.asarray(drawn["joint_offset"]).reshape(JOINTS)

    def step(self) -> None:
        """0.1 s of all hands."""
        config, state, count = self.config, self._state, len(self._variant)
        keep = math.exp(-config.time_step / config.filter_time_constant)
        k.control_step(
            0, count, np.ones(count, bool), config.time_step, config.steps_per_sample,
            min(ITERATIONS, config.solver_iterations), keep, hand_tables(), *self._grids, self._variant,
            self._parameters, self._damping, self._feedforward, self._stick, self._offset, self._noise,
            state["target"], state["filtered"], state["q"], state["dq"], state["place"], state["quaternion"],
            state["velocity"], self._memory, self._z, state["deepest"],
        )  # fmt: skip

    def pose(self, which: Array) -> tuple[Array, Array]:
        """Position ``(n, 3)`` m and rotation ``(n, 3, 3)`` of the objects' canonical frames, world frame."""
        rotation = from_quaternion(self.now.quaternion[:, which].T)
        bodies = [self._bodies[v] for v in self._variant[which]]
        rows = [
            body.from_bullet(x, R)
            for body, x, R in zip(bodies, self.now.place[:, which].T, rotation, strict=True)
        ]
        return np.stack([x for x, _ in rows]), np.stack([R for _, R in rows])


@functools.lru_cache(64)
def _law(impedance: Impedance, step: float, gravity: float) -> tuple[Array, Array]:
    """Damping ``(4, 3, 3)`` and feedforward ``(4, 3)`` of the impedance controller."""
    law = ImpedanceController(impedance, step, gravity)
    return law.damping, law.feedforward
