"""Forward kinematics, inertias and the mass matrix, against published numbers, Bullet and a mesh."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from tactile_kit.hand import kinematics
from tactile_kit.hand.controller import finger_mass_matrices
from tactile_kit.hand.kinematics import DISTAL, MIDDLE, PROXIMAL
from tactile_kit.rotations import from_quaternion, geodesic

# Centres of the tip spheres at the mean grasp, rounded to a millimetre where they were published.
TIPS = np.array(
    [[-0.020, -0.048, -0.008], [0.043, 0.008, 0.005], [-0.004, 0.052, 0.005], [-0.059, 0.008, 0.006]]
)


def postures(count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.uniform(kinematics.JOINT_LOWER, kinematics.JOINT_UPPER, (count, kinematics.JOINTS))


def test_tips_stand_where_they_were_published() -> None:
    distances = np.linalg.norm(kinematics.tip_centres(kinematics.MEAN_GRASP) - TIPS, axis=1)
    assert (distances < 2.5e-3).all(), distances


def test_the_mean_grasp_surrounds_the_origin() -> None:
    tips = kinematics.tip_centres(kinematics.MEAN_GRASP)
    inside = np.linalg.norm(tips, axis=1)
    assert (inside > 0.035).all() and (inside < 0.065).all()
    angles = np.sort(np.arctan2(tips[:, 1], tips[:, 0]))
    assert (
        np.diff(np.append(angles, angles[0] + 2 * np.pi)).max() < np.pi
    )  # no open half plane to slip out by


def test_the_passive_joint_follows_q3() -> None:
    joints = postures(3)
    angles = kinematics.expand(joints)
    assert angles.shape == (3, 16)
    np.testing.assert_array_equal(angles[:, kinematics.DRIVEN_INDEX], joints)
    np.testing.assert_array_equal(angles[:, 3::4], joints[:, 2::3])


def test_link_frames_are_bullets(loaded) -> None:
    client, body = loaded
    for joints in postures(5):
        for joint, angle in enumerate(kinematics.expand(joints).tolist()):
            client.resetJointState(body, joint, angle)
        frames = kinematics.link_frames(joints).reshape(16, 4, 4)
        for link in range(16):
            state = client.getLinkState(body, link, computeForwardKinematics=True)
            np.testing.assert_allclose(state[4], frames[link, :3, 3], atol=1e-6)
            assert geodesic(from_quaternion(np.array(state[5])), frames[link, :3, :3]) < 1e-5


def test_joint_axes_and_distances_are_the_tables() -> None:
    for joints in postures(5):
        frames = kinematics.link_frames(joints)
        origin, axis = frames[..., :3, 3], frames[..., :3, 2]
        np.testing.assert_allclose(origin[:, 0], origin[:, 1], atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(origin[:, 2] - origin[:, 1], axis=1), 0.075)
        np.testing.assert_allclose(np.linalg.norm(origin[:, 3] - origin[:, 2], axis=1), 0.040)
        np.testing.assert_allclose(
            (axis[:, 0] * axis[:, 1]).sum(-1), 0, atol=1e-12
        )  # abduction across flexion
        np.testing.assert_allclose(axis[:, 1], axis[:, 2], atol=1e-12)
        np.testing.assert_allclose(axis[:, 2], axis[:, 3], atol=1e-12)


@pytest.mark.parametrize("link", [PROXIMAL, MIDDLE, DISTAL], ids=lambda link: link.name)
def test_inertia_is_a_capsule_meshs(link: kinematics.Link) -> None:
    length = link.capsule.end - link.capsule.start
    ball = trimesh.creation.icosphere(subdivisions=4, radius=link.capsule.radius).vertices
    half = [0, 0, length / 2]
    mesh = trimesh.convex.convex_hull(np.concatenate([ball + half, ball - half]))
    mesh.density = link.mass / mesh.volume
    along_z = np.diag(mesh.moment_inertia)
    across, along = along_z[0], along_z[2]
    centre, inertia = kinematics.capsule_inertia(link)
    expected = np.full(3, across)
    expected[link.axis] = along
    np.testing.assert_allclose(np.diag(inertia), expected, rtol=3e-3)
    assert np.count_nonzero(inertia - np.diag(np.diag(inertia))) == 0
    assert centre[link.axis] == pytest.approx((link.capsule.start + link.capsule.end) / 2)


def test_mass_matrix_is_bullets_but_for_the_drives(loaded) -> None:
    """The fixed part that the URDF adds for the drives is the same in every posture."""
    client, body = loaded
    differences = []
    for joints in postures(6):
        bullets = np.array(client.calculateMassMatrix(body, kinematics.expand(joints).tolist()))
        ours = kinematics.mass_matrix(joints)
        np.testing.assert_allclose(ours, ours.T, atol=1e-15)
        differences.append(bullets - ours)
    np.testing.assert_allclose(differences, np.broadcast_to(differences[0], (6, 16, 16)), atol=1e-9)
    assert (np.linalg.eigvalsh(differences[0]) > -1e-9).all()


def test_controllers_mass_matrix_is_bullets(loaded) -> None:
    client, body = loaded
    bullets = np.array(client.calculateMassMatrix(body, kinematics.expand(kinematics.MEAN_GRASP).tolist()))
    blocks = finger_mass_matrices()
    for finger in range(4):
        own = slice(4 * finger, 4 * finger + 4)
        np.testing.assert_allclose(blocks[finger], bullets[own, own], atol=1e-9)
        bullets[own, own] = 0
    np.testing.assert_allclose(bullets, 0, atol=1e-12)  # fingers don't feel each other's inertia
