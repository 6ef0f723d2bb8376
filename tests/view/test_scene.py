"""One scene for page, replay and film: where things are, and that goals can be told apart."""

import itertools

import numpy as np
import pytest

import object_sets
from tactile_kit.hand import kinematics
from tactile_kit.rotations import octahedral
from tactile_kit.shape import MeshTable, VecBPS
from tactile_kit.view import look
from tactile_kit.view.frames import Clip, Contacts, Frame, Pose
from tactile_kit.view.raster import Camera, draw
from tactile_kit.view.scene import EYE, LAYERS, TARGET, TOUCHES, Scene

OBJECTS = object_sets.load("all")
CAMERA = Camera(EYE, TARGET, 160, 160)


def scene_of(goal: np.ndarray, layers=frozenset(LAYERS), held: str = "cube", **frame) -> tuple[Scene, Frame]:
    clip = Clip("a", OBJECTS[held], OBJECTS["cuboid"], goal, 0.4)
    clip.frames.append(
        Frame(0.0, kinematics.MEAN_GRASP, Pose(np.array([0.01, 0.0, 0.02]), np.eye(3)), **frame)
    )
    return Scene(clip, layers), clip.frames[0]


def test_all_24_goals_of_a_cube_look_different():
    pictures = []
    for goal in octahedral():
        scene, frame = scene_of(goal, frozenset({"goal"}))
        pictures.append(draw(scene, scene.show(frame), CAMERA).astype(int))
    for first, second in itertools.combinations(pictures, 2):
        different = np.abs(first - second).max(axis=2) > 20
        assert different.sum() > 150  # pixels, of some 800 that the ghost covers


@pytest.mark.parametrize("name", OBJECTS.names)
def test_paint_covers_every_object_once(name: str):
    thing = OBJECTS[name]
    parts = list(look.painted(thing))
    assert sum(len(faces) for _, (_, faces) in parts) == len(thing.faces)
    assert len({colour for colour, _ in parts}) == len(parts) >= 4
    assert len(look.edges(thing)) >= 6


def test_the_estimate_lies_where_it_is_believed_and_has_the_mesh_given():
    believed = Pose(np.array([0.0, 0.01, 0.0]), octahedral()[9])
    scene, frame = scene_of(np.eye(3), estimate=believed)
    assert scene.show(frame).poses["estimate"] is believed
    (wire,) = next(group for group in scene.groups if group.name == "estimate").parts
    reach = wire.segments.reshape(-1, 3).max(axis=0) * 2 / OBJECTS["cuboid"].extents
    assert reach == pytest.approx(np.full(3, 1.02), abs=1e-3)
    scene, frame = scene_of(np.eye(3))
    assert "estimate" not in scene.show(frame).poses  # an oracle has none


def test_vectors_are_those_that_the_policy_reads():
    import torch

    believed = Pose(np.array([0.01, 0.01, 0.0]), octahedral()[5])
    scene, frame = scene_of(np.eye(3), estimate=believed)
    segments = scene.show(frame).vectors
    cuboid = OBJECTS["cuboid"]
    read = VecBPS(MeshTable.from_meshes([(cuboid.vertices, cuboid.faces)], ["cuboid"]))(
        torch.tensor(believed.position[None]), torch.tensor(believed.rotation[None]), torch.tensor([0])
    )
    assert (segments[:, 1] - segments[:, 0]).ravel() == pytest.approx(read[0].numpy(), abs=1e-9)


def test_layers_and_weak_contacts_are_left_out():
    points = np.arange(60.0).reshape(20, 3)
    contacts = Contacts(points, np.arange(20.0))
    scene, frame = scene_of(np.eye(3), contacts=contacts)
    poses = scene.show(frame).poses
    touched = [pose.position for name, pose in poses.items() if name.startswith("touch")]
    assert np.array_equal(touched, points[::-1][:TOUCHES])
    scene.layers = frozenset()
    shown = scene.show(frame)
    assert set(shown.poses) == {"object"} and not len(shown.vectors)


def test_fingers_are_where_kinematics_say():
    scene, frame = scene_of(np.eye(3))
    tips = kinematics.tip_centres(frame.joints)
    poses = scene.show(frame).poses
    for finger in range(4):
        pose = poses[f"finger{finger}_distal"]
        (part,) = next(g for g in scene.groups if g.name == f"finger{finger}_distal").parts
        ends = part.mesh[0] @ pose.rotation.T + pose.position
        reach = np.linalg.norm(ends - tips[finger], axis=1).min()
        assert reach == pytest.approx(kinematics.DISTAL.capsule.radius, abs=1e-3)
