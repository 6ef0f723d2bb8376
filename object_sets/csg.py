"""Constructive solid geometry on manifold3d, in metres: the few verbs the authored shapes are written with."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from manifold3d import CrossSection, Manifold, Mesh64
from scipy.spatial import ConvexHull, HalfspaceIntersection

from object_sets.mass import mass_properties

GRID = (
    1e-8  # m; vertices are rounded to this, so that the last bits of another processor don't change digests
)


def to_manifold(vertices: np.ndarray, faces: np.ndarray) -> Manifold:
    """The solid of a closed mesh: vertices (V, 3) m, faces (F, 3). Check ``is_empty()``/``status()`` of the result."""
    # copies: manifold3d takes no read-only arrays
    return Manifold(Mesh64(np.array(vertices, np.float64, order="C"), np.array(faces, np.uint64, order="C")))


def to_mesh(solid: Manifold, center: str = "bounding-box") -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) float64 m, rounded to ``GRID``, and faces (F, 3) int32, of a solid; order is reproducible."""
    mesh = solid.to_mesh64()
    vertices = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3]
    return canonical(np.round(vertices / GRID) * GRID, np.asarray(mesh.tri_verts, dtype=np.int64), center)


def canonical(
    vertices: np.ndarray, faces: np.ndarray, center: str = "bounding-box"
) -> tuple[np.ndarray, np.ndarray]:
    """The same mesh, centred, vertices and faces sorted, so that equal solids are equal arrays.

    ``center`` becomes the origin: "bounding-box", "mass" (the centre of mass), or "origin" (which it is already).
    """
    if center == "bounding-box":
        vertices = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    elif center == "mass":
        vertices = vertices - mass_properties(vertices, faces).center_of_mass
    vertices = np.round(vertices / GRID) * GRID + 0.0  # + 0.0: no negative zeros
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    order = np.lexsort(vertices.T[::-1])
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    vertices, faces = vertices[order], rank[faces]
    shift = faces.argmin(axis=1)  # smallest index first: orientation stays
    faces = np.take_along_axis(faces, (shift[:, None] + np.arange(3)) % 3, axis=1)
    return vertices, faces[np.lexsort(faces.T[::-1])].astype(np.int32)


def extrusion(profile: Sequence[Sequence[float]] | np.ndarray, height: float) -> Manifold:
    """A prism along z, centred in z, over a counter-clockwise polygon (n, 2) m."""
    section = CrossSection([np.asarray(profile, dtype=np.float64)])
    return section.extrude(height).translate((0.0, 0.0, -height / 2.0))


def revolution(profile: Sequence[Sequence[float]] | np.ndarray, segments: int) -> Manifold:
    """The solid swept by a polygon (n, 2) of (radius, z), counter-clockwise, around the z axis."""
    return CrossSection([np.asarray(profile, dtype=np.float64)]).revolve(segments)


def box(
    extents: Sequence[float] | np.ndarray, center: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0)
) -> Manifold:
    """An axis-aligned box with sides (3,) m around ``center`` (3,) m."""
    return Manifold.cube(tuple(extents), True).translate(tuple(center))


def ellipsoid(
    radii: Sequence[float] | np.ndarray, center: Sequence[float] | np.ndarray, segments: int = 20
) -> Manifold:
    """An axis-aligned ellipsoid with half axes (3,) m around ``center`` (3,) m."""
    return Manifold.sphere(1.0, segments).scale(tuple(radii)).translate(tuple(center))


def limb(
    start: Sequence[float], end: Sequence[float], radii: tuple[float, float], segments: int = 12
) -> Manifold:
    """The convex hull of two spheres (a tapered capsule) from ``start`` to ``end`` (3,) m."""
    balls = [
        Manifold.sphere(r, segments).translate(tuple(c)) for r, c in zip(radii, (start, end), strict=True)
    ]
    return Manifold.batch_hull(balls)


def union(solids: Iterable[Manifold]) -> Manifold:
    """Everything that is in at least one of them."""
    total = Manifold()
    for solid in solids:
        total = total + solid
    return total


def chamfered_prism(
    profile: Sequence[Sequence[float]] | np.ndarray, height: float, chamfer: float
) -> Manifold:
    """A prism along z whose convex edges are all chamfered, also those of a non-convex profile.

    Args:
        profile: (n, 2) m, counter-clockwise polygon without collinear neighbours.
        height: m.
        chamfer: m, the width that is cut off each of the two faces beside an edge.
    """
    points = np.asarray(profile, dtype=np.float64)
    backward = _unit(np.roll(points, 1, axis=0) - points)
    forward = _unit(np.roll(points, -1, axis=0) - points)
    turn = forward[:, 1] * -backward[:, 0] - forward[:, 0] * -backward[:, 1]  # > 0 at convex corners
    normals = np.stack([-forward[:, 1], forward[:, 0]], axis=1)  # inward, of the edge after each corner
    previous = np.roll(normals, 1, axis=0)
    # Mitred inset: the corner moves so that both its edges move inward by the chamfer.
    inset = (
        points + chamfer * (normals + previous) / (1.0 + np.einsum("ij,ij->i", normals, previous))[:, None]
    )
    z = height / 2.0
    levels = [(inset, -z), (points, chamfer - z), (points, z - chamfer), (inset, z)]
    body = _loft([np.column_stack([ring, np.full(len(points), level)]) for ring, level in levels])
    for corner, back, ahead, convex in zip(points, backward, forward, turn > 0, strict=True):
        if convex:
            first, second = corner + chamfer * back, corner + chamfer * ahead
            along, out = _unit(second - first), _unit(-(back + ahead))
            wedge = [first - chamfer * along, second + chamfer * along, corner + 2.0 * chamfer * out]
            body = body - extrusion(_counter_clockwise(np.array(wedge)), 2.0 * height)
    return body


def chamfered_polyhedron(points: np.ndarray, chamfer: float) -> Manifold:
    """The convex hull of corners (n, 3) m around the origin, its edges chamfered by ``chamfer`` m on both faces."""
    points = np.asarray(points, dtype=np.float64)
    planes = np.unique(np.round(ConvexHull(points).equations, 9), axis=0)
    on = np.abs(points @ planes[:, :3].T + planes[:, 3]) < 1e-7  # (n, planes)
    cuts = []
    for first in range(len(planes)):
        for second in range(first):
            edge = points[on[:, first] & on[:, second]]
            if len(edge) >= 2:
                normals = planes[[first, second], :3]
                bisector = _unit(normals.sum(axis=0))
                inward = _unit(
                    normals[1] - normals[0] * (normals[0] @ normals[1])
                )  # in the first face, away or to it
                inward = inward if inward @ bisector < 0 else -inward
                cuts.append([*bisector, -bisector @ (edge[0] + chamfer * inward)])
    return convex_hull(HalfspaceIntersection(np.vstack([planes, cuts]), np.zeros(3)).intersections)


def fitted(solid: Manifold, extents: Sequence[float] | np.ndarray | float) -> Manifold:
    """The solid stretched along the axes to ``extents`` (3,) or one number for all, m."""
    low, high = np.array(solid.bounding_box()).reshape(2, 3)
    return solid.scale(tuple(np.broadcast_to(extents, 3) / (high - low)))


def convex_hull(points: np.ndarray) -> Manifold:
    """The convex hull of points (n, 3) m."""
    return Manifold.hull_points(np.unique(np.round(np.asarray(points) / GRID) * GRID, axis=0))


def hull_corners(points: np.ndarray, limit: int | None = None) -> np.ndarray:
    """The corners (m, 3) of the convex hull of points (n, 3), sorted; with ``limit``, the best few of them.

    With a limit, corners are taken greedily: the six extreme ones first (so the bounding box stays), then always the
    one farthest outside the hull so far. The hull of fewer corners lies inside the hull of all.
    """
    points = np.asarray(points, dtype=np.float64)
    corners = points[ConvexHull(points).vertices]
    corners = corners[np.lexsort(corners.T[::-1])]
    if limit is None or len(corners) <= limit:
        return corners
    if limit < 8:
        raise ValueError(
            f"limit = {limit}: a hull needs at least 8 corners to keep a bounding box and a volume"
        )
    chosen = list(dict.fromkeys([*corners.argmin(axis=0).tolist(), *corners.argmax(axis=0).tolist()]))
    center = corners.mean(axis=0)
    while len(chosen) < 4 or np.linalg.matrix_rank(corners[chosen] - corners[chosen[0]], tol=1e-9) < 3:
        spread = np.linalg.norm(corners[:, None] - np.vstack([corners[chosen], center]), axis=2).min(axis=1)
        chosen.append(int(spread.argmax()))
    while len(chosen) < limit:
        equations = ConvexHull(corners[chosen]).equations
        outside = (corners @ equations[:, :3].T + equations[:, 3]).max(axis=1)
        outside[chosen] = -np.inf
        chosen.append(int(outside.argmax()))
    return corners[sorted(chosen)]


def _loft(rings: list[np.ndarray]) -> Manifold:
    """The solid between polygons with the same number of corners (each (n, 3)), closed by flat caps."""
    from manifold3d import triangulate

    n, count = len(rings[0]), len(rings)
    cap = np.asarray(triangulate([rings[-1][:, :2]]), dtype=np.int64)
    bottom = np.asarray(triangulate([rings[0][:, :2]]), dtype=np.int64)[:, ::-1]
    faces = [bottom, cap + n * (count - 1)]
    here = np.arange(n)
    there = (here + 1) % n
    for level in range(count - 1):
        low, high = n * level, n * (level + 1)
        faces.append(np.column_stack([low + here, low + there, high + there]))
        faces.append(np.column_stack([low + here, high + there, high + here]))
    return to_manifold(np.concatenate(rings), np.concatenate(faces))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _counter_clockwise(polygon: np.ndarray) -> np.ndarray:
    x, y = polygon.T
    return polygon if x @ np.roll(y, -1) > y @ np.roll(x, -1) else polygon[::-1]
