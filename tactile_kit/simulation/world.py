"""One world: a Bullet client with the hand and one object, advanced one control step (0.1 s) at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pybullet
from numpy.typing import NDArray

from tactile_kit.hand import kinematics
from tactile_kit.hand.controller import CommandFilter, Impedance, ImpedanceController
from tactile_kit.simulation.bodies import Body, finger_files
from tactile_kit.simulation.client import Client
from tactile_kit.simulation.config import SAMPLES, SimulationConfig
from tactile_kit.task.rotations import from_quaternion, to_quaternion

Array = NDArray[np.float64]
# The fingers share only the fixed palm. As four bodies of four joints instead of one of sixteen every row of the
# contact solver is a quarter as long: the same motion for half the time.
FINGER_JOINTS = list(range(4))
DRIVES, TIP = FINGER_JOINTS[:3], 3
TENDON_FORCE = 100.0  # N m, no limit: the tendon holds whatever the drive can bring about
TENDON_STIFFNESS = 0.5  # share of a lag between q3 and q4 that a physics step makes good
MAX_JOINT_SPEED = 60.0  # rad/s; ten times what the controller's torque limit can bring about in free air
_ORIENTATION = to_quaternion(kinematics.HAND_ROTATION).tolist()


class PhysicsFault(RuntimeError):
    """The simulation left the range in which it means anything: not finite, or faster than the drives allow."""


@dataclass(frozen=True)
class Grasp:
    """A held object: joint angles ``(16,)``, filtered command ``(12,)``, object pose ``(3,)``, ``(3, 3)``."""

    joints: Array
    command: Array
    position: Array
    rotation: Array


class World:
    """The hand with one object.

    ``load`` builds the scene anew, which is what makes an episode repeatable whatever came before it;
    ``place`` puts hand and object into a grasp; ``step`` advances 0.1 s. ``visible`` gives the object a visual shape,
    which pictures need and simulation does not.

    Attributes:
        q, e: measured joint angles and control errors of the last control step, ``(6, 12)`` rad, oldest first.
        position, rotation: of the object's canonical frame, ``(3,)`` m and ``(3, 3)``, world frame.
        joints, speeds: true joint angles and speeds ``(16,)`` rad, rad/s.
        fingers, object: Bullet's numbers of the bodies.
    """

    def __init__(self, config: SimulationConfig, visible: bool = False) -> None:
        self.config, self.visible = config, visible
        self.bullet = Client()
        self._files = [str(path) for path in finger_files()]
        self._filter = CommandFilter(config.filter_time_constant, config.time_step)
        self.q, self.e = np.zeros((SAMPLES, kinematics.JOINTS)), np.zeros((SAMPLES, kinematics.JOINTS))
        self.position, self.rotation = np.zeros(3), np.eye(3)
        self.joints, self.speeds = np.zeros(kinematics.ALL_JOINTS), np.zeros(kinematics.ALL_JOINTS)
        self.body: Body  # set by load

    def close(self) -> None:
        """Disconnect the client."""
        self.bullet.disconnect()

    def load(self, body: Body, physics: Mapping[str, Any]) -> None:
        """Build the scene with ``body`` and the episode's ``physics`` (names and units: ``randomization``)."""
        bullet, self.body = self.bullet, body
        self.physics = dict(physics)
        bullet.resetSimulation()
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=self.config.time_step,
            numSolverIterations=self.config.solver_iterations,
            solverResidualThreshold=self.config.solver_residual,
            numSubSteps=0,
            deterministicOverlappingPairs=1,
        )
        self._mass = max(body.mass + float(physics["object_mass_offset"]), 1e-3)
        self.fingers = [self._load_finger(finger) for finger in range(kinematics.FINGERS)]
        self.object = body.create(bullet, self._mass, visible=self.visible)
        # Bullet multiplies the coefficients of the two bodies: the object's are 1 and the hand's rule.
        bullet.changeDynamics(self.object, -1, lateralFriction=1.0, linearDamping=0, angularDamping=0)
        impedance = Impedance(physics["kp"], physics["kd"], physics["series_stiffness"])
        self.controller = ImpedanceController(impedance, self.config.time_step, self.physics["gravity"])
        self._offset = np.asarray(physics["joint_offset"], dtype=np.float64)
        self.disturb(np.zeros(3), np.zeros(3))

    def _load_finger(self, number: int) -> int:
        bullet, physics = self.bullet, self.physics
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_USE_SELF_COLLISION
        flags |= pybullet.URDF_USE_SELF_COLLISION_EXCLUDE_ALL_PARENTS
        finger = bullet.loadURDF(
            self._files[number],
            kinematics.HAND_POSITION.tolist(),
            _ORIENTATION,
            useFixedBase=True,
            flags=flags,
        )
        # Damping is the whole finger's; given together with a link's friction, Bullet would drop the friction unsaid.
        bullet.changeDynamics(finger, -1, linearDamping=0, angularDamping=0)
        for link in DRIVES:
            bullet.changeDynamics(finger, link, lateralFriction=physics["link_friction"])
        bullet.changeDynamics(
            finger,
            TIP,
            lateralFriction=physics["tip_friction"],
            spinningFriction=physics["spinning_friction"],
        )
        stick = np.asarray(physics["stick_friction"])[3 * number : 3 * number + 3]
        # a velocity motor at rest is Coulomb friction; the tip has none of its own
        bullet.setJointMotorControlArray(
            finger, FINGER_JOINTS, pybullet.VELOCITY_CONTROL, forces=[*stick.tolist(), 0.0]
        )
        tendon = bullet.createConstraint(
            finger, DRIVES[-1], finger, TIP, pybullet.JOINT_GEAR, [0, 0, 1], [0, 0, 0], [0, 0, 0]
        )
        bullet.changeConstraint(
            tendon, gearRatio=-1, maxForce=TENDON_FORCE, erp=TENDON_STIFFNESS, relativePositionTarget=0
        )
        return finger

    def place(self, grasp: Grasp) -> None:
        """Put hand and object into ``grasp``, at rest."""
        for joint, angle in enumerate(grasp.joints.tolist()):
            self.bullet.resetJointState(self.fingers[joint // 4], joint % 4, angle)
        position, rotation = self.body.to_bullet(grasp.position, grasp.rotation)
        self.bullet.resetBasePositionAndOrientation(
            self.object, position.tolist(), to_quaternion(rotation).tolist()
        )
        self._filter.reset(grasp.command)
        self._read_joints()
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
        bullet, controller = self.bullet, self.controller
        for sample in range(SAMPLES):
            for _ in range(self.config.steps_per_sample):
                # the encoders' offset shifts what the controller holds
                command = self._filter.update(target)
                torques = controller.torques(self.joints, self.speeds, command - self._offset).tolist()
                for finger, forces in zip(self.fingers, torques, strict=True):
                    bullet.setJointMotorControlArray(finger, DRIVES, pybullet.TORQUE_CONTROL, forces=forces)
                if self._torque is not None:
                    bullet.applyExternalTorque(self.object, -1, self._torque, pybullet.WORLD_FRAME)
                bullet.stepSimulation()
                self._read_joints()
            self._measure(sample, None if noise is None else noise[sample])
        self._read_object()
        fastest = np.abs(self.speeds).max()
        if not math.isfinite(fastest + self.position.sum()) or fastest > MAX_JOINT_SPEED:
            raise PhysicsFault(f"joint speed {fastest:.3g} rad/s, object at {self.position}")

    @property
    def command(self) -> Array:
        """Filtered command ``(12,)`` rad."""
        return self._filter.value

    def _read_joints(self) -> None:
        read = self.bullet.getJointStates
        states = np.array([state[:2] for finger in self.fingers for state in read(finger, FINGER_JOINTS)])
        self.joints, self.speeds = states.T.copy()

    def contacts(self, other: int) -> list[tuple[Any, ...]]:
        """Bullet's contact points between any finger and the body ``other``, as of the last physics step."""
        return [
            point for finger in self.fingers for point in self.bullet.getContactPoints(finger, other)
        ]

    def _read_object(self) -> None:
        position, quaternion = self.bullet.getBasePositionAndOrientation(self.object)
        rotation = from_quaternion(np.array(quaternion))
        self.position, self.rotation = self.body.from_bullet(np.array(position), rotation)

    def _measure(self, sample: int | slice, noise: Array | None = None) -> None:
        command = self._filter.value
        angles = self.joints[kinematics.DRIVEN_INDEX]
        angles = self.controller.measured(angles, command - self._offset) + self._offset
        if noise is not None:
            angles = angles + noise
        self.q[sample] = angles
        self.e[sample] = command - angles
