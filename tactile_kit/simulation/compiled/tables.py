"""What the compiled physics reads: the hand's constants, and objects as grids of distances."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand import kinematics
from tactile_kit.hand.controller import finger_mass_matrices
from tactile_kit.hand.inverse import LOWER, ORIGINS, UPPER
from tactile_kit.shape import MeshTable, kernels
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.compiled.contacts import NODES
from tactile_kit.simulation.compiled.rows import TIP_BALLS

Array = NDArray[Any]

MARGIN = 0.026  # m of grid around the object: the fingertips' radius, the reach, and a cell
SKIN = 0.001  # m by which Bullet's convex meshes stand out
_SIDE = 4  # the closest-point kernel takes 4^3 points at once


class Hand(NamedTuple):
    """The hand's constants as the kernel takes them, float32 where nothing else is said; SI units."""

    bases: Array  # (4, 4, 3) axes as rows, then the origin
    lengths: Array  # (2,) of the proximal and middle link
    masses: Array  # (3,) of the links
    centres: Array  # (3,) of mass along them
    ball_link: Array  # (5,) int64, link that a sphere is on
    ball_at: Array  # (5,) its place along that link
    ball_radius: Array  # (5,)
    inverse_mass: Array  # (4, 3, 3)
    spread: Array  # (4, 3, 3) lower triangular factor S of the inverse mass matrix S S^T
    gathered: Array  # (4, 3, 3) S^-1
    lower: Array  # (4, 3) joint limits
    upper: Array


@functools.cache
def hand_tables() -> Hand:
    """The hand of this project."""
    bases = np.stack([np.concatenate([frame[:3, :3].T, frame[None, :3, 3]]) for frame in ORIGINS[:, 0]])
    links = (kinematics.PROXIMAL, kinematics.MIDDLE, kinematics.DISTAL)
    tip, middle = kinematics.DISTAL.capsule, kinematics.MIDDLE.capsule
    balls = [(2, at, tip.radius) for at in np.linspace(tip.start, tip.end, TIP_BALLS)]
    balls += [(1, at, middle.radius) for at in (0.3 * middle.end + 0.7 * middle.start, middle.end)]
    link, along, radius = (np.array(column) for column in zip(*balls, strict=True))
    inverse = np.linalg.inv(kinematics.TENDON.T @ finger_mass_matrices() @ kinematics.TENDON)
    inverse[:, 0, 1:] = inverse[:, 1:, 0] = 0.0  # abduction and flexion do not mix; the rest is rounding
    spread = np.linalg.cholesky(inverse)
    tables: tuple[Any, ...] = (
        bases,
        [kinematics.PROXIMAL_LENGTH, kinematics.MIDDLE_LENGTH],
        [one.mass for one in links],
        [(one.capsule.start + one.capsule.end) / 2 for one in links],
        link,
        along,
        radius + SKIN,
        inverse,
        spread,
        np.linalg.inv(spread),
        LOWER,
        UPPER,
    )
    return Hand(
        *(
            np.ascontiguousarray(table, np.int64 if name == "ball_link" else np.float32)
            for name, table in zip(Hand._fields, tables, strict=True)
        )
    )


class Grids(NamedTuple):
    """Distance and outward direction around bodies, in their frames of principal axes."""

    nodes: Array  # (N, 32, 32, 32, 4) float32: m, zero inside; unit vector
    first: Array  # (N, 3) m, where the first node is
    spacing: Array  # (N, 3) m


def distance_grids(bodies: Sequence[Body], meshes: MeshTable) -> Grids:
    """The grids of all bodies, whose surfaces are ``meshes``.

    Raises:
        ValueError: the closest points of a mesh are not to be found; names the object.
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
    return Grids(grids, first, spacing)


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
