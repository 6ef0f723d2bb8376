"""Writes the hand, or single fingers of it, as a URDF: capsules for contacts, inertias, a passive joint a finger."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_kit.hand import kinematics
from tactile_kit.hand.kinematics import DISTAL, MIDDLE, PROXIMAL, Link

# The abduction joint's own moving part is not in the public masses; a gram keeps Bullet's recursion regular.
ABDUCTION_MASS = 1e-3
ABDUCTION_INERTIA = 1e-6
# Reflected inertia of the three drives about their joint axes, kg m². Not published; this order of magnitude is usual
# for geared finger drives. It keeps the controller's stiffness term stable up to a step of 1/60 s in every posture and
# for the gains of every preset; 1e-3 would not: the softest mode of q2 and q3 then grows unless friction holds it.
ARMATURE = 1.5e-3
# What the tendon's pulleys add to the distal link, kg m². Not published either; without it the contact and the tendon
# share a link of a few 1e-6 kg m², and Bullet's solver needs twice the iterations for the same result.
TENDON_INERTIA = 3e-4
JOINT_NAMES = ("abduction", "flexion", "middle", "distal")


def _numbers(values) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _inertial(parent: ElementTree.Element, mass: float, centre, inertia) -> None:
    element = ElementTree.SubElement(parent, "inertial")
    ElementTree.SubElement(element, "origin", xyz=_numbers(centre), rpy="0 0 0")
    ElementTree.SubElement(element, "mass", value=f"{mass:.9g}")
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ElementTree.SubElement(element, "inertia", {key: f"{inertia[at]:.9g}" for key, at in names.items()})


def _capsule(parent: ElementTree.Element, link: Link) -> None:
    """URDF capsules lie along z: turn them along the link's axis."""
    centre = np.zeros(3)
    centre[link.axis] = (link.capsule.start + link.capsule.end) / 2
    rpy = (0.0, np.pi / 2, 0.0) if link.axis == 0 else (-np.pi / 2, 0.0, 0.0)
    size = {"radius": f"{link.capsule.radius:.9g}", "length": f"{link.capsule.end - link.capsule.start:.9g}"}
    for kind in ("visual", "collision"):
        element = ElementTree.SubElement(parent, kind)
        ElementTree.SubElement(element, "origin", xyz=_numbers(centre), rpy=_numbers(rpy))
        ElementTree.SubElement(ElementTree.SubElement(element, "geometry"), "capsule", size)


def hand_urdf(fingers: Sequence[int] = range(kinematics.FINGERS)) -> str:
    """The hand's URDF as text: base ``palm`` (no collision geometry), four revolute joints for each of ``fingers``."""
    robot = ElementTree.Element("robot", name="hand")
    palm = ElementTree.SubElement(robot, "link", name="palm")
    _inertial(palm, kinematics.BASE_MASS * len(fingers), np.zeros(3), np.eye(3) * 1e-3)
    links = (None, PROXIMAL, MIDDLE, DISTAL)
    lower = kinematics.expand(kinematics.JOINT_LOWER)
    upper = kinematics.expand(kinematics.JOINT_UPPER)
    for finger in fingers:
        parent = "palm"
        for index, (joint, link, origin) in enumerate(
            zip(JOINT_NAMES, links, kinematics.joint_origins(finger), strict=True)
        ):
            name = f"f{finger + 1}_{joint}"
            element = ElementTree.SubElement(robot, "link", name=name)
            # isotropic: Bullet refuses tensors that no body could have
            drive = np.eye(3) * (TENDON_INERTIA if link is DISTAL else ARMATURE)
            if link is None:
                _inertial(element, ABDUCTION_MASS, np.zeros(3), np.eye(3) * ABDUCTION_INERTIA + drive)
            else:
                centre, inertia = kinematics.capsule_inertia(link)
                _inertial(element, link.mass, centre, inertia + drive)
                _capsule(element, link)
            hinge = ElementTree.SubElement(robot, "joint", name=f"{name}_joint", type="revolute")
            ElementTree.SubElement(hinge, "parent", link=parent)
            ElementTree.SubElement(hinge, "child", link=name)
            rpy = Rotation.from_matrix(origin[:3, :3]).as_euler("xyz")
            ElementTree.SubElement(hinge, "origin", xyz=_numbers(origin[:3, 3]), rpy=_numbers(rpy))
            ElementTree.SubElement(hinge, "axis", xyz="0 0 1")
            bounds = {
                "lower": f"{lower[4 * finger + index]:.9g}",
                "upper": f"{upper[4 * finger + index]:.9g}",
            }
            ElementTree.SubElement(hinge, "limit", {"effort": "10", "velocity": "100", **bounds})
            parent = name
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode") + "\n"
