"""One world: a Bullet client with the hand and one object, advanced one control step (0.1 s) at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand import kinematics
from tactile_kit.hand.controller import CommandFilter, Impedance, ImpedanceController
from tactile_kit.rotations import to_quaternion
from tactile_kit.simulation.bodies import MIN_MASS, Body
from tactile_kit.simulation.client import Client
from tactile_kit.simulation.config import SAMPLES, SimulationConfig
from tactile_kit.simulation.hand import Hand
from tactile_kit.simulation.quiet_bullet import pybullet

Array = NDArray[np.float64]
MAX_JOINT_SPEED = 60.0  # rad/s; ten times what the controller's torque limit can bring about in free air
LOADS_A_SCENE = (
    500  # then a fresh one: Bullet keeps a kilobyte of every removed body until its scene is reset
)


class PhysicsFault(RuntimeError):
    """The simulation left the range in which it means anything: not finite, or faster than the drives allow."""


@dataclass(frozen=True)
class Grasp:
    """A held object: joint angles ``(16,)``, filtered command ``(12,)``, object pose ``(3,)``, ``(3, 3)``."""

    joints: Array
    command: Array
    position: Array
    rotation: Array


@dataclass(frozen=True)
class Snapshot:
    """A moment of an episode, to go back to: joints and speeds ``(16,)``, command ``(12,)``, pose and twist."""

    joints: Array
    speeds: Array
    command: Array
    position: Array
    rotation: Array
    velocity: Array  # of the centre of mass, (3,) m/s
    spin: Array  # (3,) rad/s


class World:
    """The hand with one object.

    ``load`` brings in an object and an episode's physics, ``place`` puts both into a grasp, ``step`` advances 0.1 s.
    An episode is repeatable to the bit, whatever came before it in the same world. ``visible`` gives the object a
    visual shape, which pictures need and simulation does not.

    Attributes:
        q, e: measured joint angles and control errors of the last control step, ``(6, 12)`` rad, oldest first.
        position, rotation: of the object's canonical frame, ``(3,)`` m and ``(3, 3)``, world frame.
        joints, speeds: true joint angles and speeds ``(16,)`` rad, rad/s.
        hand, object: the fingers, and Bullet's number of the object.
    """

    def __init__(self, config: SimulationConfig, visible: bool = False) -> None:
        self.config, self.visible = config, visible
        self.bullet = Client()
        self._filter = CommandFilter(config.filter_time_constant, config.time_step)
        self.q, self.e = np.zeros((SAMPLES, kinematics.JOINTS)), np.zeros((SAMPLES, kinematics.JOINTS))
        self.position, self.rotation = np.zeros(3), np.eye(3)
        self.joints, self.speeds = np.zeros(kinematics.ALL_JOINTS), np.zeros(kinematics.ALL_JOINTS)
        self.body: Body  # with object, set by load
        self.object = -1
        self.hand: Hand | None = None
        self._shapes: dict[int, int] = {}
        self._loads = 0

    def close(self) -> None:
        """Disconnect the client."""
        self.bullet.disconnect()

    def load(self, body: Body, physics: Mapping[str, Any]) -> None:
        """Bring in ``body`` and the episode's ``physics`` (names and units: ``randomization``)."""
        bullet, self.body = self.bullet, body
        self.physics = dict(physics)
        if self.hand is None or self._loads >= LOADS_A_SCENE:
            self.hand = self._build()
        else:
            bullet.removeBody(self.object)
        self._loads += 1
        self.hand.forget_contacts()
        self.hand.set_physics(physics)
        self._mass = max(body.mass + float(physics["object_mass_offset"]), MIN_MASS)
        if body.number not in self._shapes:
            self._shapes[body.number] = body.shape(bullet)
        self.object = body.create(bullet, self._mass, self._shapes[body.number], visible=self.visible)
        # Bullet multiplies the coefficients of the two bodies: the object's are 1 and the hand's rule.
        bullet.changeDynamics(self.object, -1, lateralFriction=1.0, linearDamping=0, angularDamping=0)
        impedance = Impedance(physics["kp"], physics["kd"], physics["series_stiffness"])
        self.controller = ImpedanceController(impedance, self.config.time_step, physics["gravity"])
        self._offset = np.asarray(physics["joint_offset"], dtype=np.float64)
        self.disturb(np.zeros(3), np.zeros(3))

    def _build(self) -> Hand:
        self.bullet.resetSimulation()
        self._shapes.clear()
        self._loads = 0
        self.bullet.setPhysicsEngineParameter(
            fixedTimeStep=self.config.time_step,
            numSolverIterations=self.config.solver_iterations,
            solverResidualThreshold=self.config.solver_residual,
            numSubSteps=0,
            deterministicOverlappingPairs=1,
        )
        return Hand(self.bullet)

    def place(self, grasp: Grasp) -> None:
        """Put hand and object into ``grasp``, at rest."""
        still = np.zeros(3)
        self._put(Snapshot(**vars(grasp), speeds=np.zeros(kinematics.ALL_JOINTS), velocity=still, spin=still))

    def pin(self) -> Callable[[], None]:
        """Something that puts the object back to where it is now, at rest."""
        place = self.bullet.getBasePositionAndOrientation(self.object)

        def back() -> None:
            self.bullet.resetBasePositionAndOrientation(self.object, *place)
            self.bullet.resetBaseVelocity(self.object, [0.0] * 3, [0.0] * 3)

        return back

    def pace(self) -> tuple[float, float]:
        """Speed (m/s) and spin (rad/s) of the object."""
        velocity, spin = self.bullet.getBaseVelocity(self.object)
        return math.hypot(*velocity), math.hypot(*spin)

    def overlap(self, anew: bool = False) -> float:
        """How deep (m) a finger is inside the object, at the last physics step or found ``anew``; 0 without touch."""
        if anew:
            self.bullet.performCollisionDetection()
        distances = [point[8] for point in self.bullet.getContactPoints(self.object)]
        return max(0.0, -min(distances)) if distances else 0.0

    def snapshot(self) -> Snapshot:
        """The present moment."""
        velocity, spin = self.bullet.getBaseVelocity(self.object)
        return Snapshot(
            self.joints, self.speeds, self.command.copy(), self.position, self.rotation,
            np.array(velocity), np.array(spin),
        )  # fmt: skip

    def restore(self, moment: Snapshot) -> None:
        """Go back to ``moment`` of the loaded episode; contacts are found anew, so the future may differ slightly."""
        assert self.hand is not None
        self.hand.forget_contacts()
        self._put(moment)

    def _put(self, moment: Snapshot) -> None:
        assert self.hand is not None
        self.hand.place(moment.joints, moment.speeds)
        position, rotation = self.body.to_bullet(moment.position, moment.rotation)
        self.bullet.resetBasePositionAndOrientation(
            self.object, position.tolist(), to_quaternion(rotation).tolist()
        )
        self.bullet.resetBaseVelocity(self.object, moment.velocity.tolist(), moment.spin.tolist())
        self._filter.reset(moment.command)
        self.joints, self.speeds = self.hand.read()
        self._read_object()
        self._measure(slice(None))

    def set_gravity(self, gravity: float) -> None:
        """Gravity in m/s² from now on, and the fingers' compensation of it; ends any disturbance."""
        self.physics["gravity"] = gravity
        self.controller.compensate(gravity)
        self.disturb(np.zeros(3), np.zeros(3))

    def disturb(self, force: Array, torque: Array) -> None:
        """Force ``(3,)`` N and torque ``(3,)`` Nm on the object until the next call, world frame.

        The force tilts gravity, which costs nothing; the hand's links feel it too, but are a hundred times stiffer.
        """
        gravity = np.array([0.0, 0.0, -float(self.physics["gravity"])])
        self.bullet.setGravity(*(gravity + np.asarray(force) / self._mass).tolist())
        self._torque = np.asarray(torque).tolist() if np.any(torque) else None

    def step(self, target: Array, noise: Array | None = None) -> None:
        """Advance 0.1 s towards the target joint angles ``(12,)`` rad; ``noise`` ``(6, 12)`` is added to the angles.

        Raises:
            PhysicsFault: the state is not finite or impossibly fast.
        """
        bullet, hand = self.bullet, self.hand
        assert hand is not None
        for sample in range(SAMPLES):
            for _ in range(self.config.steps_per_sample):
                # the encoders' offset shifts what the controller holds
                command = self._filter.update(target) - self._offset
                hand.drive(self.controller.torques(self.joints, self.speeds, command))
                if self._torque is not None:
                    bullet.applyExternalTorque(self.object, -1, self._torque, pybullet.WORLD_FRAME)
                bullet.stepSimulation()
                self.joints, self.speeds = hand.read()
            self._measure(sample, None if noise is None else noise[sample])
        self._read_object()
        fastest = np.abs(self.speeds).max()
        if not math.isfinite(fastest + self.position.sum()) or fastest > MAX_JOINT_SPEED:
            self.hand = None  # what is not finite stays in Bullet's memory: build the scene anew
            raise PhysicsFault(f"joint speed {fastest:.3g} rad/s, object at {self.position}")

    @property
    def command(self) -> Array:
        """Filtered command ``(12,)`` rad."""
        return self._filter.value

    def _read_object(self) -> None:
        position, quaternion = self.bullet.getBasePositionAndOrientation(self.object)
        rotation = np.array(self.bullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
        self.position, self.rotation = self.body.from_bullet(np.array(position), rotation)

    def _measure(self, sample: int | slice, noise: Array | None = None) -> None:
        command, driven = self._filter.value, self.joints[kinematics.DRIVEN_INDEX]
        angles = self.controller.measured(driven, command - self._offset) + self._offset
        if noise is not None:
            angles += noise
        self.q[sample] = angles
        self.e[sample] = command - angles
