"""Objects in Bullet: where they stand, how heavy they turn, and whether their surface is the mesh's."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from tactile_kit.rotations import exp, random_rotations, to_quaternion
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.client import Client

MARGIN = 1e-3  # m, by which Bullet's convex hulls are larger
# Principal axes along the mesh's, turned by 45° with an offset centre of mass, and offset along one axis.
NAMES = ["cube", "l_shape", "t_shape", "emergency_switch"]


@pytest.fixture(scope="module")
def client():
    client = Client()
    yield client
    client.disconnect()


def posed(client: Client, body: Body, position: np.ndarray, rotation: np.ndarray, mass: float = 0.05) -> int:
    identity = body.create(client, mass)
    x, R = body.to_bullet(position, rotation)
    client.resetBasePositionAndOrientation(identity, x.tolist(), to_quaternion(R).tolist())
    return identity


@pytest.mark.parametrize("name", NAMES)
def test_poses_come_back(things, name: str) -> None:
    body, rng = Body(things[name]), np.random.default_rng(0)
    for rotation in random_rotations(rng, 20):
        position = rng.normal(size=3)
        x, R = body.from_bullet(*body.to_bullet(position, rotation))
        np.testing.assert_allclose(x, position, atol=1e-12)
        np.testing.assert_allclose(R, rotation, atol=1e-12)


def test_bullets_frame_is_the_centre_of_mass(things) -> None:
    thing = things["l_shape"]
    body = Body(thing)
    assert np.linalg.norm(thing.center_of_mass) > 5e-3
    position, _ = body.to_bullet(np.zeros(3), exp(np.array([0.0, 0.0, np.pi / 2])))
    np.testing.assert_allclose(position, np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ thing.center_of_mass)
    np.testing.assert_allclose(body.axes @ np.diag(body.moments) @ body.axes.T, thing.inertia, atol=1e-12)


@pytest.mark.parametrize("name", ["cube", "t_shape", "emergency_switch"])
def test_bounding_box_in_bullet_is_the_meshs(client, things, name: str) -> None:
    """Upright, where Bullet's boxes are tight (only bodies whose principal axes are the mesh's)."""
    thing, place = things[name], np.array([0.1, -0.2, 0.3])
    identity = posed(client, Body(thing), place, np.eye(3))
    low, high = map(np.array, client.getAABB(identity, -1))
    for found, expected in ((low, thing.vertices.min(0) + place), (high, thing.vertices.max(0) + place)):
        assert (np.abs(found - expected) < 1e-6 + 5e-3).all()
    excess = (high - low) - thing.extents
    assert (excess > 0).all() and np.ptp(excess) < 2e-3
    client.removeBody(identity)


@pytest.mark.parametrize("name", NAMES)
def test_surface_in_bullet_is_the_posed_shapes(client, things, name: str) -> None:
    """Distances to a small ball at many places, the body turned and shifted: the convex parts' less the margin.

    The parts approximate a non-convex mesh; it is the mesh itself for a convex one.
    """
    thing, rng = things[name], np.random.default_rng(1)
    rotation, place = random_rotations(rng, 1)[0], np.array([0.3, 0.2, -0.1])
    identity = posed(client, Body(thing), place, rotation)
    ball = client.createMultiBody(0, client.createCollisionShape(client.GEOM_SPHERE, radius=1e-3))
    parts = [trimesh.convex.convex_hull(part) for part in thing.parts]
    if thing.convex:
        parts = [trimesh.Trimesh(thing.vertices, thing.faces)]
    points = rng.uniform(-0.06, 0.06, (150, 3))  # in the mesh's frame
    distances = np.min([-trimesh.proximity.signed_distance(part, points) for part in parts], axis=0)
    outside = distances > 4e-3
    assert outside.sum() > 60
    for point, distance in zip(points[outside], distances[outside], strict=True):
        client.resetBasePositionAndOrientation(ball, (rotation @ point + place).tolist(), [0, 0, 0, 1])
        found = min(contact[8] for contact in client.getClosestPoints(identity, ball, 0.2))
        assert found == pytest.approx(distance - 1e-3 - MARGIN, abs=5e-5)
    client.removeBody(identity)
    client.removeBody(ball)


@pytest.mark.parametrize("name", NAMES)
def test_a_torque_turns_the_body_by_the_meshs_inertia(client, things, name: str) -> None:
    thing, mass, torque = things[name], 0.07, np.array([1e-3, 2e-3, -1e-3])
    client.setTimeStep(1 / 240)
    for rotation in random_rotations(np.random.default_rng(2), 3):
        identity = posed(client, Body(thing), np.zeros(3), rotation, mass)
        client.changeDynamics(identity, -1, linearDamping=0, angularDamping=0)
        client.applyExternalTorque(identity, -1, torque.tolist(), client.WORLD_FRAME)
        client.stepSimulation()
        speed = np.array(client.getBaseVelocity(identity)[1])
        inertia = rotation @ (mass * thing.inertia) @ rotation.T
        np.testing.assert_allclose(speed, np.linalg.solve(inertia, torque) / 240, rtol=1e-3, atol=1e-5)
        client.removeBody(identity)


def test_known_mass_or_the_default(things) -> None:
    assert Body(things["apple"]).mass == pytest.approx(0.068)
    assert Body(things["cube"]).mass == pytest.approx(0.05)
