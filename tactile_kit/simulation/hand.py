"""The hand in Bullet: four fingers, each a body of its own with a tendon between its last two joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand import kinematics
from tactile_kit.rotations import to_quaternion
from tactile_kit.simulation.bodies import finger_files
from tactile_kit.simulation.client import Client
from tactile_kit.simulation.quiet_bullet import pybullet

Array = NDArray[np.float64]

# The fingers share only the fixed palm. As four bodies of four joints instead of one of sixteen every row of the
# contact solver is a quarter as long: the same motion for half the time.
JOINTS = list(range(4))
DRIVES, TIP = JOINTS[:3], 3
TENDON_FORCE = 100.0  # no limit: the tendon holds whatever the drive can bring about
TENDON_ERP = 0.5  # share of a lag between q3 and q4 that a physics step makes good
_POSITION = kinematics.HAND_POSITION.tolist()
_ORIENTATION = to_quaternion(kinematics.HAND_ROTATION).tolist()
_ASIDE = [[0.0, 0.0, 5.0 + 5.0 * finger] for finger in range(kinematics.FINGERS)]  # out of reach of anything


class Hand:
    """The fingers of one empty Bullet scene, loaded once and reused for every episode.

    Attributes:
        fingers: Bullet's body numbers.
    """

    def __init__(self, bullet: Client) -> None:
        self.bullet = bullet
        self.fingers = [self._load(str(path)) for path in finger_files()]

    def _load(self, path: str) -> int:
        bullet = self.bullet
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_USE_SELF_COLLISION
        flags |= pybullet.URDF_USE_SELF_COLLISION_EXCLUDE_ALL_PARENTS
        finger = bullet.loadURDF(path, _POSITION, _ORIENTATION, useFixedBase=True, flags=flags)
        # Damping is the whole finger's; given together with a link's friction, Bullet would drop the friction unsaid.
        bullet.changeDynamics(finger, -1, linearDamping=0, angularDamping=0)
        tendon = bullet.createConstraint(
            finger, DRIVES[-1], finger, TIP, pybullet.JOINT_GEAR, [0, 0, 1], [0, 0, 0], [0, 0, 0]
        )
        bullet.changeConstraint(
            tendon, gearRatio=-1, maxForce=TENDON_FORCE, erp=TENDON_ERP, relativePositionTarget=0
        )
        return finger

    def set_physics(self, physics: Mapping[str, Any]) -> None:
        """Take over the friction of an episode's ``physics`` (names and units: ``randomization``)."""
        stick = np.asarray(physics["stick_friction"]).reshape(kinematics.FINGERS, kinematics.DRIVEN)
        for finger, forces in zip(self.fingers, stick.tolist(), strict=True):
            for link in DRIVES:
                self.bullet.changeDynamics(finger, link, lateralFriction=physics["link_friction"])
            self.bullet.changeDynamics(
                finger,
                TIP,
                lateralFriction=physics["tip_friction"],
                spinningFriction=physics["spinning_friction"],
            )
            # a velocity motor at rest is Coulomb friction; the tip has none of its own
            self.bullet.setJointMotorControlArray(
                finger, JOINTS, pybullet.VELOCITY_CONTROL, forces=[*forces, 0.0]
            )

    def forget_contacts(self) -> None:
        """Drop everything that Bullet remembers of earlier contacts, so that an episode depends on its start only."""
        for finger, place in zip(self.fingers, _ASIDE, strict=True):
            self.bullet.resetBasePositionAndOrientation(finger, place, _ORIENTATION)
        self.bullet.performCollisionDetection()
        for finger in self.fingers:
            self.bullet.resetBasePositionAndOrientation(finger, _POSITION, _ORIENTATION)

    def place(self, joints: Array, speeds: Array) -> None:
        """Set all angles and speeds ``(16,)`` rad, rad/s."""
        for number, (angle, speed) in enumerate(zip(joints.tolist(), speeds.tolist(), strict=True)):
            self.bullet.resetJointState(self.fingers[number // 4], number % 4, angle, speed)

    def drive(self, torques: Array) -> None:
        """Apply torques ``(4 fingers, 3)`` Nm during the next physics step."""
        send = self.bullet.setJointMotorControlArray
        for finger, forces in zip(self.fingers, torques.tolist(), strict=True):
            send(finger, DRIVES, pybullet.TORQUE_CONTROL, forces=forces)

    def read(self) -> tuple[Array, Array]:
        """Angles and speeds ``(16,)`` rad, rad/s."""
        read = self.bullet.getJointStates
        states = [state for finger in self.fingers for state in read(finger, JOINTS)]
        return np.array([state[0] for state in states]), np.array([state[1] for state in states])

    def contacts(self, other: int) -> list[tuple[Any, ...]]:
        """Bullet's contact points between any finger and the body ``other``, as of the last physics step."""
        return [point for finger in self.fingers for point in self.bullet.getContactPoints(finger, other)]
