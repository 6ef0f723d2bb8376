"""A small renderer: one mesh, orthographic, flat shading, dark feature edges, no window and no graphics driver."""

from __future__ import annotations

import numpy as np

LIGHT = np.array([-0.35, 0.55, 0.76])  # towards the light; x right, y up, z to the viewer
EDGE_ANGLE = 25.0  # degrees between the faces of neighbouring pixels from which an edge is drawn
OVERSAMPLING = 3
VIEW = (35.0, 28.0)  # azimuth and elevation of the eye, degrees


def view(azimuth: float, elevation: float) -> np.ndarray:
    """(3, 3) rotation from the object frame (z up) to the picture (x right, y up, z to the viewer); degrees."""
    a, e = np.radians([azimuth, elevation])
    turn = np.array([[-np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0], [np.cos(a), np.sin(a), 0.0]])
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(e), -np.sin(e)], [0.0, np.sin(e), np.cos(e)]])
    return tilt @ turn


def render(
    vertices: np.ndarray, faces: np.ndarray, color: tuple[float, float, float], pixels: int, width: float
) -> np.ndarray:
    """A picture (pixels, pixels, 4) float64 in 0..1, RGBA, transparent background.

    Args:
        vertices: (V, 3) m; faces: (F, 3), outward.
        color: RGB in 0..1.
        width: m, side of the square that the picture shows, centred on the origin.
    """
    size = pixels * OVERSAMPLING
    points = vertices @ view(*VIEW).T
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    screen = (corners[:, :, :2] / width * np.array([1.0, -1.0]) + 0.5) * size
    depth = np.full((size, size), -np.inf)
    owner = np.full((size, size), -1)
    for face in np.flatnonzero(normals[:, 2] > 0):
        _fill(int(face), screen[face], corners[face, :, 2], depth, owner)
    image = np.zeros((size, size, 4))
    covered = owner >= 0
    light = LIGHT / np.linalg.norm(LIGHT)
    shade = 0.38 + 0.62 * np.clip(normals @ light, 0.0, 1.0)
    image[covered, :3] = shade[owner[covered], None] * np.array(color)
    image[covered, 3] = 1.0
    image[_edges(owner, normals, depth, covered, 0.02 * width)] = (0.1, 0.1, 0.12, 1.0)
    blocks = image.reshape(pixels, OVERSAMPLING, pixels, OVERSAMPLING, 4)
    alpha = blocks[..., 3].mean(axis=(1, 3))
    rgb = (blocks[..., :3] * blocks[..., 3:]).mean(axis=(1, 3)) / np.maximum(alpha, 1e-9)[..., None]
    return np.dstack([np.clip(rgb, 0.0, 1.0), alpha])


def _fill(face: int, triangle: np.ndarray, heights: np.ndarray, depth: np.ndarray, owner: np.ndarray) -> None:
    """Draw one triangle (3, 2) px with heights (3,) into the depth buffer."""
    size = len(depth)
    low = np.clip(np.floor(triangle.min(axis=0)).astype(int), 0, size)
    high = np.clip(np.ceil(triangle.max(axis=0)).astype(int) + 1, 0, size)
    x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
    (ax, ay), (bx, by), (cx, cy) = triangle
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if x.size == 0 or abs(area) < 1e-9:
        return
    v = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
    w = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
    z = heights[0] + v * (heights[1] - heights[0]) + w * (heights[2] - heights[0])
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    nearer = (v >= -1e-9) & (w >= -1e-9) & (v + w <= 1.0 + 1e-9) & (z > depth[window])
    depth[window][nearer] = z[nearer]
    owner[window][nearer] = face


def _edges(
    owner: np.ndarray, normals: np.ndarray, depth: np.ndarray, covered: np.ndarray, step: float
) -> np.ndarray:
    """(size, size) bool: where the outline, a crease or a jump in depth lies between neighbouring pixels."""
    edges = np.zeros_like(covered)
    smooth = np.cos(np.radians(EDGE_ANGLE))
    for shift in ((0, 1), (1, 0)):
        other, there = np.roll(owner, shift, (0, 1)), np.roll(covered, shift, (0, 1))
        both = covered & there
        edges |= covered ^ there
        bend = np.zeros_like(covered)
        bend[both] = np.einsum("ni,ni->n", normals[owner[both]], normals[other[both]]) < smooth
        jump = np.zeros_like(covered)
        jump[both] = np.abs(depth[both] - np.roll(depth, shift, (0, 1))[both]) > step
        edges |= bend | jump
    return edges
