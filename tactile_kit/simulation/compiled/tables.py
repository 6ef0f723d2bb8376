"""What the compiled physics reads: the hand's constants, and objects as grids of distances."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand import kinematics
from tactile_kit.hand.controller import finger_mass_matrices
from tactile_kit.hand.inverse import LOWER, ORIGINS, UPPER
from tactile_kit.shape import MeshTable, kernels
from tactile_kit.simulation.bodies import Body

Array = NDArray[np.float64]

NODES = 32  # of a grid along each axis
MARGIN = 0.026  # m of grid around the object: the fingertips' radius, the reach, and a cell
SKIN = 0.001  # m by which Bullet's convex meshes stand out
_SIDE = 4  # the closest-point kernel takes 4^3 points at once


@functools.cache
def hand_tables() -> tuple[Array, ...]:
    """The hand as the kernel's functions take it: bases, lengths, masses, balls, inverse inertia and joint limits."""
    bases = np.stack([np.concatenate([frame[:3, :3].T, frame[None, :3, 3]]) for frame in ORIGINS[:, 0]])
    links = (kinematics.PROXIMAL, kinematics.MIDDLE, kinematics.DISTAL)
    tip, middle = kinematics.DISTAL.capsule, kinematics.MIDDLE.capsule
    balls = [(2, at, tip.radius) for at in np.linspace(tip.start, tip.end, 3)]
    balls += [(1, at, middle.radius) for at in (0.3 * middle.end + 0.7 * middle.start, middle.end)]
    mass = kinematics.TENDON.T @ finger_mass_matrices() @ kinematics.TENDON
    return (
        bases,
        np.array([kinematics.PROXIMAL_LENGTH, kinematics.MIDDLE_LENGTH]),
        np.array([link.mass for link in links]),
        np.array([(link.capsule.start + link.capsule.end) / 2 for link in links]),
        np.array([ball[0] for ball in balls]),
        np.array([ball[1] for ball in balls]),
        np.array([ball[2] + SKIN for ball in balls]),
        np.linalg.inv(mass),
        LOWER,
        UPPER,
    )


def distance_grids(bodies: Sequence[Body], meshes: MeshTable) -> tuple[NDArray[np.float32], Array, Array]:
    """Distance and outward direction around every body, in its frame of principal axes.

    Returns:
        Grids ``(N, 32, 32, 32, 4) float32`` (m, unit vector; zero inside), their first nodes ``(N, 3)`` m and the
        spacing of their nodes ``(N, 3)`` m.
    """
    count = len(bodies)
    grids = np.empty((count, NODES, NODES, NODES, 4), np.float32)
    first, spacing = np.empty((count, 3)), np.empty((count, 3))
    for index, body in enumerate(bodies):
        corners = (meshes.triangles(index).reshape(-1, 3) - body.com) @ body.axes
        low, high = corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN
        first[index], spacing[index] = low, (high - low) / (NODES - 1)
        vectors = -_vectors(body, meshes, index, low, spacing[index])
        distance = np.linalg.norm(vectors, axis=-1, keepdims=True)
        # inside, away from the centre of mass
        outwards = np.where(distance > 0, vectors, _nodes(low, spacing[index]))
        length = np.maximum(np.linalg.norm(outwards, axis=-1, keepdims=True), 1e-12)
        grids[index] = np.concatenate([distance, outwards / length], axis=-1)
    return grids, first, spacing


def _nodes(low: Array, spacing: Array) -> Array:
    return low + spacing * np.stack(np.meshgrid(*[np.arange(NODES)] * 3, indexing="ij"), axis=-1)


def _vectors(body: Body, meshes: MeshTable, index: int, low: Array, spacing: Array) -> Array:
    """From every node to the surface, ``(32, 32, 32, 3)`` m."""
    blocks = NODES // _SIDE
    within = np.stack(np.meshgrid(*[np.arange(_SIDE)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    corner = np.stack(np.meshgrid(*[np.arange(blocks) * _SIDE] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    # instead of the nodes the body moves
    place = -body.axes.T @ body.com - low - corner * spacing
    turned = np.tile(body.axes.T, (len(place), 1, 1))
    vectors = np.empty((len(place), kernels.K, 3))
    status, _ = kernels.forward(
        np.ascontiguousarray((within * spacing).T), place, turned, np.full(len(place), index, np.int64),
        *meshes.arrays(np.dtype(np.float64)), vectors, np.zeros((1, kernels.K, 4)), False,
    )  # fmt: skip
    if status != kernels.OK:
        raise ValueError(f"{body.name}: no distances around it (status {status} of the closest-point search)")
    shape = (blocks, blocks, blocks, _SIDE, _SIDE, _SIDE, 3)
    return vectors.reshape(shape).transpose(0, 3, 1, 4, 2, 5, 6).reshape(NODES, NODES, NODES, 3)
