"""Writes the hand as MJCF (MuJoCo): the links, limits and inertias of the URDF, and the impedance controller as
MuJoCo's own actuators, so that it runs at every physics step, some 1 kHz, as on the robot.

An actuator's activation is the filtered command. Its torque is the controller's stiffness times the error, limited;
damping and dry friction are the joint's. Gains and friction here are nominal: an episode sets its own.
"""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_kit.hand import kinematics
from tactile_kit.hand.controller import TORQUE_LIMIT, Impedance
from tactile_kit.hand.kinematics import DISTAL, MIDDLE, PROXIMAL, Link
from tactile_kit.hand.urdf import ABDUCTION_INERTIA, ABDUCTION_MASS, ARMATURE, JOINT_NAMES, TENDON_INERTIA

_LINKS = (None, PROXIMAL, MIDDLE, DISTAL)
# The tendon's stiffness in MuJoCo's terms: the time (s) in which it makes a lag between q3 and q4 good.
TENDON_TIME = 0.004
# MuJoCo's dry friction yields a little below its limit: with its defaults (0.02 s, 0.9) a joint that should stick
# creeps on.
STICK_TIME, STICK_IMPEDANCE = 0.004, 0.999


def _numbers(values) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _frame(element: ElementTree.Element, frame: np.ndarray) -> None:
    x, y, z, w = Rotation.from_matrix(frame[:3, :3]).as_quat()
    element.set("pos", _numbers(frame[:3, 3]))
    element.set("quat", _numbers((w, x, y, z)))


def _link(body: ElementTree.Element, link: Link) -> None:
    centre, inertia = kinematics.capsule_inertia(link)
    diagonal = _numbers(np.diag(inertia))
    ElementTree.SubElement(
        body, "inertial", pos=_numbers(centre), mass=f"{link.mass:g}", diaginertia=diagonal
    )
    ends = np.zeros((2, 3))
    ends[:, link.axis] = link.capsule.start, link.capsule.end
    kind = "tip" if link is DISTAL else "link"
    size = f"{link.capsule.radius:.9g}"
    ElementTree.SubElement(body, "geom", {"class": kind, "fromto": _numbers(ends.ravel()), "size": size})


def _defaults(robot: ElementTree.Element) -> None:
    default = ElementTree.SubElement(robot, "default")
    for name, contact in (("link", "3"), ("tip", "4")):  # tips have torsional friction
        own = ElementTree.SubElement(default, "default", {"class": name})
        # priority: the hand's friction holds, whatever the object's, as in Bullet
        ElementTree.SubElement(own, "geom", type="capsule", condim=contact, priority="1")


def hand_mjcf(filter_time_constant: float) -> str:
    """The hand's MJCF as text: bodies ``f1_abduction`` … ``f4_distal`` in the world, joints ``…_joint``, and the
    controller's actuators named as the driven joints.

    ``filter_time_constant`` is that of the command's low pass, s.
    """
    robot = ElementTree.Element("mujoco", model="hand")
    ElementTree.SubElement(robot, "compiler", angle="radian", autolimits="true")
    _defaults(robot)
    world = ElementTree.SubElement(robot, "worldbody")
    excluded = ElementTree.SubElement(robot, "contact")
    tendons = ElementTree.SubElement(robot, "equality")
    drives = ElementTree.SubElement(robot, "actuator")
    palm = np.eye(4)
    palm[:3, :3], palm[:3, 3] = kinematics.HAND_ROTATION, kinematics.HAND_POSITION
    lower, upper = kinematics.expand(kinematics.JOINT_LOWER), kinematics.expand(kinematics.JOINT_UPPER)
    impedance = Impedance()
    stiffness, damping = impedance.stiffness * impedance.ratio, impedance.damping * impedance.ratio
    for finger in range(kinematics.FINGERS):
        parent, before = world, palm
        for index, origin in enumerate(kinematics.joint_origins(finger)):
            name, number = f"f{finger + 1}_{JOINT_NAMES[index]}", 4 * finger + index
            parent = ElementTree.SubElement(parent, "body", name=name, gravcomp="1")
            _frame(parent, before @ origin)
            before = np.eye(4)
            driven = index < kinematics.DRIVEN
            ElementTree.SubElement(
                parent, "joint", name=f"{name}_joint", axis="0 0 1",
                range=_numbers((lower[number], upper[number])),
                armature=f"{ARMATURE if driven else TENDON_INERTIA:g}",
                damping=f"{damping if driven else 0:.9g}",
                solreffriction=f"{STICK_TIME:g} 1", solimpfriction=f"{STICK_IMPEDANCE:g} {STICK_IMPEDANCE:g} 0.001",
            )  # fmt: skip
            link = _LINKS[index]
            if link is None:
                inertia = _numbers([ABDUCTION_INERTIA] * 3)
                mass = f"{ABDUCTION_MASS:g}"
                ElementTree.SubElement(parent, "inertial", pos="0 0 0", mass=mass, diaginertia=inertia)
            else:
                _link(parent, link)
            if driven:
                ElementTree.SubElement(
                    drives, "general", name=name, joint=f"{name}_joint",
                    dyntype="filterexact", dynprm=f"{filter_time_constant:.9g}", actearly="true",
                    gainprm=f"{stiffness:.9g}", biastype="affine", biasprm=f"0 {-stiffness:.9g} 0",
                    forcerange=f"{-TORQUE_LIMIT:g} {TORQUE_LIMIT:g}",
                )  # fmt: skip
        root = f"f{finger + 1}"
        ElementTree.SubElement(excluded, "exclude", body1=f"{root}_flexion", body2=f"{root}_distal")
        ElementTree.SubElement(
            tendons, "joint", joint1=f"{root}_distal_joint", joint2=f"{root}_middle_joint",
            polycoef="0 1 0 0 0", solref=f"{TENDON_TIME:g} 1",
        )  # fmt: skip
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode") + "\n"
