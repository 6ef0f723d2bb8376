"""Draws triangles and lines into a picture, compiled: what films need of a renderer, and no display or GPU."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tactile_kit.view.frames import Pose
from tactile_kit.view.scene import Lines, Scene, Shown, Solid

Array = NDArray[np.floating]
LIGHT = np.array([0.45, -0.55, 0.70]) / np.linalg.norm([0.45, -0.55, 0.70])
AMBIENT = 0.6
PAPER = 250.0  # of the background, of 255
NEAR = 0.02  # m
FINE = 2


class Camera:
    """Looks from ``eye`` at ``target`` (m, z up) into a picture ``(height, width)``; ``angle``: rad, vertical view."""

    def __init__(self, eye: Array, target: Array, height: int, width: int, angle: float = 0.75) -> None:
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        self._axes, self._eye = np.stack([right, np.cross(forward, right), forward]), eye
        self._scale, self._middle = 0.5 * height / np.tan(angle / 2), np.array([0.5 * width, 0.5 * height])
        self.height, self.width = height, width
        self._given = eye, target, angle

    def times(self, factor: int) -> Camera:
        """The same view in a larger picture."""
        eye, target, angle = self._given
        return Camera(eye, target, factor * self.height, factor * self.width, angle)

    def project(self, points: Array) -> Array:
        """``(..., 3)`` m to pixels right, pixels down and depth in m."""
        seen = (points - self._eye) @ self._axes.T
        depth = np.maximum(seen[..., 2:], NEAR)
        return np.concatenate([self._middle + self._scale * seen[..., :2] / depth, depth], axis=-1)


def draw(scene: Scene, shown: Shown, camera: Camera) -> NDArray[np.uint8]:
    """The scene as a picture ``(height, width, 3)``: what hides first, then what is seen through, then lines.

    Drawn ``FINE`` times larger and averaged, against jagged edges.
    """
    camera = camera.times(FINE)
    picture = np.full((camera.height, camera.width, 3), PAPER, np.float32)
    depth = np.full((camera.height, camera.width), np.inf, np.float32)
    clear: list[tuple[Solid, Pose]] = []
    lines: list[tuple[Lines, Pose]] = []
    for group in scene.groups:
        pose = shown.poses.get(group.name)
        for part in group.parts if pose is not None else ():
            assert pose is not None
            if isinstance(part, Lines):
                lines.append((part, pose))
            elif part.opacity < 1:
                clear.append((part, pose))
            else:
                _draw_solid(picture, depth, part, pose, camera)
    for part, pose in clear:  # only their nearest surface, so that no inner face shows through
        _draw_depth(depth, part, pose, camera)
    for part, pose in clear:
        _draw_solid(picture, depth, part, pose, camera)
    for one, pose in lines:
        _draw_lines(picture, depth, _placed(one.segments, pose), one.colour, 0.7 * FINE * one.width, camera)
    if len(shown.vectors):
        from tactile_kit.view.look import BASIS

        _draw_lines(picture, depth, shown.vectors, BASIS, FINE, camera)
    return _shrunk(picture, FINE)


def _placed(points: Array, pose: Pose) -> Array:
    return points @ pose.rotation.T + pose.position


def _corners(part: Solid, pose: Pose) -> Array:
    vertices, faces = part.mesh
    return _placed(vertices, pose)[faces]


def _draw_solid(picture: Array, depth: Array, part: Solid, pose: Pose, camera: Camera) -> None:
    corners = _corners(part, pose)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    light = AMBIENT + (1 - AMBIENT) * np.maximum(normals @ LIGHT, 0.0)
    colours = light[:, None] * np.array(part.colour, dtype=np.float64)
    _fill(picture, depth, camera.project(corners), colours, part.opacity)


def _draw_depth(depth: Array, part: Solid, pose: Pose, camera: Camera) -> None:
    corners = camera.project(_corners(part, pose))
    _fill(np.empty((0, 0, 3), np.float32), depth, corners, np.zeros((len(corners), 3)), 0.0)


def _draw_lines(
    picture: Array, depth: Array, segments: Array, colour: Any, width: float, camera: Camera
) -> None:
    _stroke(picture, depth, camera.project(segments), np.array(colour, dtype=np.float64), width)


@njit(cache=True)
def _fill(
    picture: Array, depth: Array, triangles: Array, colours: Array, opacity: float
) -> None:  # pragma: no cover
    """Triangles ``(N, 3, 3)`` of pixels and depth that face the eye; opacity 0 writes depth alone."""
    height, width = depth.shape
    for n in range(len(triangles)):
        a, b, c = triangles[n, 0], triangles[n, 1], triangles[n, 2]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area >= 0:  # pixels count downwards, so faces turned to the eye go round the other way
            continue
        left = max(int(min(a[0], b[0], c[0])), 0)
        right = min(int(max(a[0], b[0], c[0])) + 1, width - 1)
        top = max(int(min(a[1], b[1], c[1])), 0)
        bottom = min(int(max(a[1], b[1], c[1])) + 1, height - 1)
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                px, py = x + 0.5, y + 0.5
                u = ((b[0] - px) * (c[1] - py) - (b[1] - py) * (c[0] - px)) / area
                v = ((c[0] - px) * (a[1] - py) - (c[1] - py) * (a[0] - px)) / area
                w = 1.0 - u - v
                if u < 0 or v < 0 or w < 0:
                    continue
                z = 1.0 / (u / a[2] + v / b[2] + w / c[2])
                if z > depth[y, x] + 1e-6:
                    continue
                depth[y, x] = min(z, depth[y, x])
                if opacity > 0:
                    for k in range(3):
                        picture[y, x, k] += opacity * (colours[n, k] - picture[y, x, k])


@njit(cache=True)
def _stroke(
    picture: Array, depth: Array, segments: Array, colour: Array, width: float
) -> None:  # pragma: no cover
    """Segments ``(N, 2, 3)`` of pixels and depth; what lies behind a surface stays hidden."""
    height, columns = depth.shape
    reach = int(np.ceil(width / 2))
    for n in range(len(segments)):
        a, b = segments[n, 0], segments[n, 1]
        steps = int(max(abs(b[0] - a[0]), abs(b[1] - a[1]))) + 1
        for step in range(steps + 1):
            share = step / steps
            x, y = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
            z = 1.0 / ((1 - share) / a[2] + share / b[2])
            for row in range(int(y) - reach, int(y) + reach + 1):
                for column in range(int(x) - reach, int(x) + reach + 1):
                    if not (0 <= row < height and 0 <= column < columns):
                        continue
                    if (row + 0.5 - y) ** 2 + (column + 0.5 - x) ** 2 > (width / 2) ** 2 + 0.25:
                        continue
                    if z < depth[row, column] + 1e-3:
                        for k in range(3):
                            picture[row, column, k] = colour[k]


@njit(cache=True)
def _shrunk(picture: Array, factor: int) -> NDArray[np.uint8]:  # pragma: no cover
    """Means over ``factor`` by ``factor`` pixels."""
    height, width = picture.shape[0] // factor, picture.shape[1] // factor
    small = np.empty((height, width, 3), np.uint8)
    for y in range(height):
        for x in range(width):
            for k in range(3):
                total = 0.0
                for i in range(factor):
                    for j in range(factor):
                        total += picture[factor * y + i, factor * x + j, k]
                small[y, x, k] = np.uint8(min(max(total / factor**2, 0.0), 255.0))
    return small
