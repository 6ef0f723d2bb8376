"""Shapes and colours: the painted object, its edges, the hand's capsules and palm. Nothing here moves."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from object_sets import Object
from tactile_kit.hand import kinematics
from tactile_kit.hand.kinematics import Link

Array = NDArray[np.float64]
Colour = tuple[int, int, int]
Mesh = tuple[Array, NDArray[np.int64]]  # vertices (V, 3) m, faces (F, 3)

# Six that the colour-blind can tell apart (Okabe and Ito), one for each direction +x, -x, +y, -y, +z, -z of the
# object's own frame: two that are seen say how it lies, so all 24 goals of a cube look different.
FACES: tuple[Colour, ...] = (
    (213, 94, 0),
    (86, 180, 233),
    (0, 158, 115),
    (240, 228, 66),
    (0, 114, 178),
    (204, 121, 167),
)
HAND: Colour = (120, 124, 132)
TIPS: Colour = (66, 70, 78)
PALM: Colour = (150, 154, 162)
ESTIMATE: Colour = (20, 20, 20)
TOUCH: Colour = (230, 30, 30)
BASIS: Colour = (110, 60, 160)
SHARP = np.deg2rad(20.0)  # between faces, from which their edge is drawn
# The palm's back, an ellipsoid in the hand frame, m: to be seen only, no public drawing of it exists.
WRIST, ROUND = np.array([0.0, -0.005, 0.045]), np.array([0.042, 0.052, 0.02])


def painted(thing: Object) -> Iterator[tuple[Colour, Mesh]]:
    """The object's faces by the direction that they look in mostly, each colour once."""
    corners = thing.vertices[thing.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = np.abs(normals).argmax(axis=1)
    side = 2 * axis + (normals[np.arange(len(normals)), axis] < 0)
    for number, colour in enumerate(FACES):
        faces = thing.faces[side == number]
        if len(faces):
            used, renumbered = np.unique(faces, return_inverse=True)
            yield colour, (thing.vertices[used], renumbered.reshape(-1, 3))


def edges(thing: Object) -> Array:
    """``(N, 2, 3)`` m: the sharp edges of the surface, or all of it where it is smooth."""
    mesh = trimesh.Trimesh(thing.vertices, thing.faces, process=True)
    kept = mesh.face_adjacency_edges[mesh.face_adjacency_angles > SHARP]
    if len(kept) < 6:  # an ellipsoid has no edges: a net instead
        kept = mesh.edges_unique
    return np.asarray(mesh.vertices[kept], dtype=np.float64)


@cache
def capsule(link: Link) -> Mesh:
    """A link's capsule in the link's frame."""
    length = link.capsule.end - link.capsule.start
    mesh = trimesh.creation.capsule(length, link.capsule.radius, count=[14, 14])
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    vertices = vertices - vertices.mean(axis=0)
    # trimesh's lie along z
    vertices = vertices[:, [2, 0, 1]] if link.axis == 0 else vertices[:, [1, 2, 0]]
    vertices[:, link.axis] += (link.capsule.start + link.capsule.end) / 2
    return vertices, np.asarray(mesh.faces, dtype=np.int64)


@cache
def ball(radius: float) -> Mesh:
    """A small ball around the origin."""
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=radius)
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)


@cache
def palm() -> Mesh:
    """What holds the fingers, world frame: around their bases and back to the wrist. To be seen; it touches nothing."""
    sphere = trimesh.creation.icosphere(subdivisions=1, radius=0.017).vertices
    wrist = trimesh.creation.icosphere(subdivisions=2).vertices * ROUND
    base = kinematics.FINGER_POSITIONS - np.array([0.0, 0.0, 0.012])
    points = np.concatenate([(base[:, None] + sphere).reshape(-1, 3), wrist + WRIST])
    mesh = trimesh.Trimesh(points, ConvexHull(points).simplices, process=True)
    mesh.fix_normals()
    vertices = np.asarray(mesh.vertices) @ kinematics.HAND_ROTATION.T + kinematics.HAND_POSITION
    return vertices, np.asarray(mesh.faces, dtype=np.int64)
