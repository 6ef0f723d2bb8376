"""The URDF: joints, limits, masses and inertias, as written and as Bullet reads them."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest

from tactile_kit.hand import kinematics, urdf
from tactile_kit.hand.kinematics import DISTAL, MIDDLE, PROXIMAL

LINKS = [None, PROXIMAL, MIDDLE, DISTAL] * 4


@pytest.fixture(scope="module")
def robot() -> ElementTree.Element:
    return ElementTree.fromstring(urdf.hand_urdf())


def number(element: ElementTree.Element, path: str, key: str) -> float:
    found = element.find(path)
    assert found is not None, path
    return float(found.attrib[key])


def test_sixteen_revolute_joints_with_the_published_limits(robot: ElementTree.Element) -> None:
    joints = robot.findall("joint")
    assert [joint.get("type") for joint in joints] == ["revolute"] * 16
    limits = np.array([[number(joint, "limit", key) for key in ("lower", "upper")] for joint in joints])
    np.testing.assert_allclose(limits[0::4], [[-0.5, 0.5]] * 4)
    np.testing.assert_allclose(limits[1::4], [[-0.34, 1.5]] * 4)
    np.testing.assert_allclose(limits[2::4], [[-0.13, 1.7]] * 4)
    np.testing.assert_allclose(limits[3::4], [[-0.13, 1.7]] * 4)


def test_masses_and_geometry(robot: ElementTree.Element) -> None:
    masses = {link.get("name"): number(link, "inertial/mass", "value") for link in robot.findall("link")}
    assert masses.pop("palm") == pytest.approx(0.4)
    assert masses["f3_flexion"] == 0.1 and masses["f3_middle"] == 0.075 and masses["f3_distal"] == 0.025
    palm, *links = robot.findall("link")
    assert palm.find("collision") is None
    for link, part in zip(links, LINKS, strict=True):
        path = "collision/geometry/capsule"
        if part is None:
            assert link.find(path) is None
        else:
            assert number(link, path, "radius") == part.capsule.radius
            assert number(link, path, "length") == pytest.approx(part.capsule.end - part.capsule.start)


def test_no_inertia_is_one_that_no_body_has(robot: ElementTree.Element) -> None:
    for link in robot.findall("link"):
        principal = np.sort([number(link, "inertial/inertia", key) for key in ("ixx", "iyy", "izz")])
        assert principal[0] > 0 and principal[0] + principal[1] >= principal[2]


def test_bullet_takes_the_inertias_from_the_file(loaded) -> None:
    client, body = loaded
    for index, link in enumerate(LINKS):
        info = client.getDynamicsInfo(body, index)
        if link is None:
            assert info[0] == pytest.approx(urdf.ABDUCTION_MASS)
            continue
        centre, inertia = kinematics.capsule_inertia(link)
        drive = urdf.TENDON_INERTIA if link is DISTAL else urdf.ARMATURE
        assert info[0] == pytest.approx(link.mass)
        np.testing.assert_allclose(info[3], centre, atol=1e-9)
        np.testing.assert_allclose(np.sort(info[2]), np.sort(np.diag(inertia) + drive), rtol=1e-6)


def test_collision_capsules_stand_where_the_table_says(loaded) -> None:
    """A small ball beside the tip: Bullet's distance is the capsule's, at the tip's end and at its flank."""
    client, body = loaded
    for joint, angle in enumerate(kinematics.expand(kinematics.MEAN_GRASP).tolist()):
        client.resetJointState(body, joint, angle)
    ball = client.createMultiBody(0, client.createCollisionShape(client.GEOM_SPHERE, radius=0.001))
    frames = kinematics.link_frames(kinematics.MEAN_GRASP)[:, 3]
    for finger, frame in enumerate(frames):
        for local, gap in (([0, 0.0331 + 0.01417 + 0.004, 0], 0.003), ([0.02417, 0.024, 0], 0.009)):
            place = frame[:3, :3] @ np.array(local) + frame[:3, 3]
            client.resetBasePositionAndOrientation(ball, place.tolist(), [0, 0, 0, 1])
            points = client.getClosestPoints(body, ball, 0.05, linkIndexA=4 * finger + 3)
            assert min(point[8] for point in points) == pytest.approx(gap, abs=1e-4)
    client.removeBody(ball)
