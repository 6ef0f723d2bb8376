"""Objects as Bullet bodies: convex hulls as they are, several parts as a compound read from a cached OBJ file."""

from __future__ import annotations

import hashlib
import itertools
import logging
import os
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from object_sets import Object
from object_sets.mass import DEFAULT_MASS
from object_sets.storage import cache_directory, write_atomic
from tactile_kit.hand.kinematics import FINGERS
from tactile_kit.hand.urdf import hand_urdf
from tactile_kit.rotations import to_quaternion

log = logging.getLogger(__name__)

MIN_MASS = 1e-3  # kg; no drawn offset takes an object below it


def _write_once(path: Path, text: str) -> Path:
    """Write atomically unless the (content-named) file is there already with this text."""
    data = text.encode()
    try:
        there = path.read_bytes() == data
    except FileNotFoundError:
        there = False
    if not there:
        write_atomic(path, data)
    return path


def _for_bullet(name: str, text: str) -> Path:
    """A file of that text, for Bullet reads nothing else: in the cache or, on a full disk, among temporary files."""
    try:
        return _write_once(cache_directory() / name, text)
    except OSError as problem:
        spare = Path(tempfile.gettempdir()) / f"tactile-kit-{os.getuid()}" / name
        log.warning("%s: can't be written (%s); takes %s", cache_directory() / name, problem.strerror, spare)
        return _write_once(spare, text)


def finger_files() -> list[Path]:
    """URDFs of the single fingers in the cache, named by their content."""
    texts = [hand_urdf([finger]) for finger in range(FINGERS)]
    return [
        _for_bullet(f"hand/{hashlib.sha256(text.encode()).hexdigest()[:16]}.urdf", text) for text in texts
    ]


def _obj_text(parts: tuple[np.ndarray, ...]) -> str:
    lines, offset = [], 1
    for index, points in enumerate(parts):
        hull = ConvexHull(points)
        lines.append(f"o part{index}")
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points]
        lines += [f"f {a + offset} {b + offset} {c + offset}" for a, b, c in hull.simplices]
        offset += len(points)
    return "\n".join(lines) + "\n"


class Body:
    """What Bullet needs to make one object quickly, again and again.

    The frame outside is the mesh's canonical frame; Bullet's own is the centre of mass and its principal axes.
    """

    _numbers = itertools.count()

    def __init__(self, thing: Object) -> None:
        self.thing = thing
        self.name, self.number = thing.name, next(Body._numbers)  # the number names it within a process
        self.mass = thing.mass if thing.mass is not None else DEFAULT_MASS
        moments, axes = np.linalg.eigh(thing.inertia)
        if np.linalg.det(axes) < 0:
            axes[:, 0] *= -1
        if np.allclose(thing.inertia, np.diag(np.diag(thing.inertia)), atol=1e-12):
            moments, axes = np.diag(thing.inertia).copy(), np.eye(3)
        self.moments = moments
        self.com = np.asarray(thing.center_of_mass, dtype=np.float64)
        self.axes = axes
        self._axes_quaternion = to_quaternion(axes).tolist()
        self._identity = bool(np.allclose(axes, np.eye(3)) and np.allclose(self.com, 0, atol=1e-9))
        self._vertices = [part.tolist() for part in thing.parts]
        self._surface = thing.vertices[thing.faces].reshape(-1, 3)  # corner by corner, for flat shading
        self._text = _obj_text(thing.parts) if len(thing.parts) > 1 else ""

    def shape(self, bullet) -> int:
        """Make the collision shape in the client ``bullet``, for any number of bodies; returns its id."""
        file = ""
        if self._text:
            file = str(_for_bullet(f"bodies/{self.thing.digest}.obj", self._text))
            shape = bullet.createCollisionShape(bullet.GEOM_MESH, fileName=file)
        else:
            shape = bullet.createCollisionShape(bullet.GEOM_MESH, vertices=self._vertices[0])
        if shape < 0:
            raise RuntimeError(
                f"Bullet made no collision shape for {self.name} ({file or 'one convex part'})"
            )
        return shape

    def create(self, bullet, mass: float, shape: int | None = None, visible: bool = False) -> int:
        """Make the body of ``mass`` kg in the client ``bullet``, of a shape made before; returns its id."""
        body = bullet.createMultiBody(
            baseMass=mass,
            baseCollisionShapeIndex=self.shape(bullet) if shape is None else shape,
            baseVisualShapeIndex=self._look(bullet) if visible else -1,
            baseInertialFramePosition=self.com.tolist(),
            baseInertialFrameOrientation=self._axes_quaternion,
        )
        bullet.changeDynamics(body, -1, mass=mass, localInertiaDiagonal=(self.moments * mass).tolist())
        return body

    def _look(self, bullet) -> int:
        triangles = self._surface.reshape(-1, 3, 3)
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return bullet.createVisualShape(
            bullet.GEOM_MESH,
            vertices=self._surface.tolist(),
            indices=list(range(len(self._surface))),
            normals=np.repeat(normals, 3, axis=0).tolist(),
            rgbaColor=[0.90, 0.45, 0.15, 1.0],
        )

    def to_bullet(self, position: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Canonical frame pose to Bullet's pose (centre of mass, principal axes)."""
        if self._identity:
            return position, rotation
        return position + rotation @ self.com, rotation @ self.axes

    def from_bullet(self, position: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inverse of :meth:`to_bullet`."""
        if self._identity:
            return position, rotation
        rotation = rotation @ self.axes.T
        return position - rotation @ self.com, rotation
