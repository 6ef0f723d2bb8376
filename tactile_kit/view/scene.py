"""The scene: what is there (nodes) and where it is at a frame. Whoever draws it, browser, replay or film, asks here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray

from tactile_kit.hand import kinematics
from tactile_kit.shape.function import basis_points, bps_vectors
from tactile_kit.shape.tables import MeshTable
from tactile_kit.view import look
from tactile_kit.view.frames import Clip, Contacts, Frame, Pose
from tactile_kit.view.look import Colour, Mesh

Array = NDArray[np.float64]
LAYERS = ("hand", "goal", "estimate", "contacts", "basis")  # that can be left out
LINKS = ((1, kinematics.PROXIMAL), (2, kinematics.MIDDLE), (3, kinematics.DISTAL))
TOUCHES = 12  # contacts shown at once, the strongest
OVER = 1.02  # larger than life, so that an estimate that is right is seen around the object
STILL = Pose(np.zeros(3), np.eye(3))
# Where cameras stand, m, and what they look at: the ghost of the goal is then right of the hand.
EYE, TARGET = np.array([0.40, -0.32, 0.13]), np.array([0.035, 0.065, 0.06])
# Of the ghost, m: beside the object as the cameras below see it, clear of the fingers.
ASIDE = np.array([0.115, 0.165, -0.005])


@dataclass(frozen=True)
class Solid:
    """A triangle mesh of one colour, in the frame of its group; ``opacity`` 1 hides what is behind."""

    name: str
    mesh: Mesh
    colour: Colour
    opacity: float = 1.0


@dataclass(frozen=True)
class Lines:
    """Segments ``(N, 2, 3)`` m of one colour, in the frame of their group."""

    name: str
    segments: Array
    colour: Colour
    width: float = 2.0


@dataclass(frozen=True)
class Group:
    """What moves as one. ``layer``: by which it is left out; None: never."""

    name: str
    parts: tuple[Solid | Lines, ...]
    layer: str | None = None


@dataclass(frozen=True)
class Shown:
    """Where everything is at one frame: poses by the name of a group (absent: not there), and the vectors of the basis
    points, ``(64, 2, 3)`` m from point to surface."""

    poses: Mapping[str, Pose]
    vectors: Array


@dataclass
class Scene:
    """The scene of one clip.

    Attributes:
        clip: whose frames it shows.
        layers: which of ``LAYERS`` are shown.
    """

    clip: Clip
    layers: frozenset[str] = frozenset(LAYERS[:-1])
    groups: tuple[Group, ...] = field(init=False)

    def __post_init__(self) -> None:
        given = self.clip.given
        self._meshes = MeshTable.from_meshes([(given.vertices, given.faces)], [given.name])
        self.groups = tuple(self._groups())

    def _groups(self) -> Iterator[Group]:
        yield Group("palm", (Solid("palm", look.palm(), look.PALM),), "hand")
        for finger in range(kinematics.FINGERS):
            for _, link in LINKS:
                colour = look.TIPS if link is kinematics.DISTAL else look.HAND
                yield Group(
                    f"finger{finger}_{link.name}", (Solid("link", look.capsule(link), colour),), "hand"
                )
        coloured = list(look.painted(self.clip.held))
        yield Group("object", tuple(Solid(f"side{i}", mesh, c) for i, (c, mesh) in enumerate(coloured)))
        ghost = [Solid(f"side{i}", mesh, c, 0.45) for i, (c, mesh) in enumerate(coloured)]
        outline = Lines("edges", look.edges(self.clip.held), (90, 90, 90), 1.0)
        yield Group("goal", (*ghost, outline), "goal")
        believed = Lines("edges", OVER * look.edges(self.clip.given), look.ESTIMATE)
        yield Group("estimate", (believed,), "estimate")
        for number in range(TOUCHES):
            yield Group(f"touch{number}", (Solid("mark", look.ball(0.005), look.TOUCH),), "contacts")
        dot, dots = look.ball(0.0015), []
        for number, point in enumerate(basis_points()):
            dots.append((dot[0] + point, dot[1] + number * len(dot[0])))
        points = np.concatenate([v for v, _ in dots]), np.concatenate([f for _, f in dots])
        yield Group("basis", (Solid("points", points, look.BASIS),), "basis")

    def show(self, frame: Frame) -> Shown:
        """Where everything is at ``frame``."""
        poses: dict[str, Pose] = {"palm": STILL, "object": frame.truth, "basis": STILL}
        frames = kinematics.link_frames(frame.joints)
        for finger in range(kinematics.FINGERS):
            for joint, link in LINKS:
                placed = frames[finger, joint]
                poses[f"finger{finger}_{link.name}"] = Pose(placed[:3, 3], placed[:3, :3])
        poses["goal"] = Pose(ASIDE, self.clip.goal)
        if frame.estimate is not None:
            poses["estimate"] = frame.estimate
        for number, point in enumerate(_strongest(frame.contacts)):
            poses[f"touch{number}"] = Pose(point, np.eye(3))
        hidden = {group.name for group in self.groups if group.layer and group.layer not in self.layers}
        shown = {name: pose for name, pose in poses.items() if name not in hidden}
        return Shown(shown, self._vectors(frame.belief) if "basis" in self.layers else np.empty((0, 2, 3)))

    def above_goal(self) -> Array:
        """Where the ghost is named, ``(3,)`` m."""
        return ASIDE + np.array([0.0, 0.0, 0.5 * float(np.linalg.norm(self.clip.held.extents)) + 0.01])

    def _vectors(self, belief: Pose) -> Array:
        x = torch.tensor(belief.position[None], dtype=torch.float64)
        R = torch.tensor(belief.rotation[None], dtype=torch.float64)
        vectors = bps_vectors(self._meshes, x, R, torch.zeros(1, dtype=torch.int64))[0].numpy()
        points = basis_points()
        return np.stack([points, points + vectors], axis=1)


def _strongest(contacts: Contacts) -> Array:
    return contacts.points[np.argsort(-contacts.forces)[:TOUCHES]]
