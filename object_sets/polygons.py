"""OBJ and OFF: the two text formats of polygons, read here.

trimesh reads the other formats. Of these two it (5.2) resolves negative OBJ indices from the end of the file, so that
all bodies become the last one, skips faces behind a tab, fails on trailing comments, byte-order marks and polygons of
several sizes, and cuts concave polygons into fans that fold over themselves. Only geometry is read: materials, normals,
colours, curves and lines are passed over.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator, Sequence

import numpy as np

BOM = b"\xef\xbb\xbf"
MOST = 10_000_000  # vertices or faces that an OFF file may announce


def read_obj(data: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (V, 3) float64, faces (F, 3) int64, and the group ("o" or "g") of each face (F,) int64.

    Raises:
        ValueError: a line that can't be read; it is named by its number.
    """
    numbers, polygons, groups = array("d"), [], array("q")
    group, count = 0, 0
    for line, words in _lines(data):
        key = words[0]
        try:
            if key == b"v":
                numbers.extend((float(words[1]), float(words[2]), float(words[3])))
                count += 1
            elif key in (b"f", b"fo"):  # fo: what faces were called before version 3
                corners = _corners(words[1:], count)
                if len(corners) > 2:  # points and lines are no surface
                    polygons.append(corners)
                    groups.append(group)
            elif key in (b"o", b"g"):
                group += 1
        except (ValueError, IndexError) as error:
            shown = b" ".join(words)[:60].decode(errors="replace")
            raise ValueError(f"line {line}: {shown!r} is no vertex or face of the format") from error
    vertices = np.frombuffer(numbers, np.float64).reshape(-1, 3).copy()
    faces, owner = triangles_of(vertices, polygons)
    return vertices, faces, np.frombuffer(groups, np.int64)[owner]


def read_off(data: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (V, 3) float64, faces (F, 3) int64 and groups (F,), all 0; errors as of ``read_obj``."""
    data = data.removeprefix(BOM)
    head = re.match(rb"(?:\s|#[^\n\r]*)*(ST)?C?N?(4)?(n)?OFF", data)
    if head is None or head[2] or head[3] or re.match(rb"[ \t]*BINARY", data[head.end() :]):
        raise ValueError("neither OFF nor one of its kinds with normals, colours or texture")
    lines = _lines(data[head.end() :], data[: head.end()].count(b"\n"))
    try:
        line, words = next(lines)
        vertex_count, face_count = int(words[0]), int(words[1])
        if not (0 <= vertex_count <= MOST and 0 <= face_count <= MOST):
            raise ValueError(f"announces {vertex_count} vertices and {face_count} faces; allowed are {MOST}")
        numbers, polygons = array("d"), []
        for _ in range(vertex_count):
            line, words = next(lines)
            numbers.extend((float(words[0]), float(words[1]), float(words[2])))
        for _ in range(face_count):
            line, words = next(lines)
            size = int(words[0])
            corners = [int(word) for word in words[1 : 1 + size]]
            if len(corners) < size:
                raise ValueError("fewer corners than it says")
            if size > 2:  # points and lines are no surface
                polygons.append(corners)
    except StopIteration as error:
        raise ValueError("ends before all its vertices and faces") from error
    except (ValueError, IndexError) as error:
        raise ValueError(f"line {line}: {error}") from error
    vertices = np.frombuffer(numbers, np.float64).reshape(-1, 3).copy()
    faces, owner = triangles_of(vertices, polygons)
    return vertices, faces, np.zeros(len(owner), np.int64)


def _lines(data: bytes, before: int = 0) -> Iterator[tuple[int, list[bytes]]]:
    """The words of every line that has some, with its number; comments cut off, continued lines joined."""
    whole: list[bytes] = []
    for number, raw in enumerate(data.removeprefix(BOM).splitlines(), before + 1):
        words = raw.partition(b"#")[0].split()
        more = bool(words) and words[-1].endswith(b"\\")
        if more:
            words[-1] = words[-1][:-1]
        whole += [word for word in words if word]
        if not more and whole:
            yield number, whole
            whole = []
    if whole:
        yield number, whole


def _corners(words: Sequence[bytes], count: int) -> list[int]:
    """Indices of a face from 0; negative ones count back from the vertices that have been read so far."""
    corners = []
    for word in words:
        index = int(word.partition(b"/")[0])
        if index == 0 or index < -count:
            raise ValueError(f"index {index}")
        corners.append(index - 1 if index > 0 else count + index)
    return corners


def triangles_of(vertices: np.ndarray, polygons: Sequence[Sequence[int]]) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (F, 3) of polygons, and the polygon (F,) that each is of."""
    faces: list[Sequence[int] | np.ndarray] = []
    owner: list[int] = []
    for number, polygon in enumerate(polygons):
        pieces = [polygon] if len(polygon) == 3 else triangulated(vertices, polygon)
        faces.extend(pieces)
        owner.extend([number] * len(pieces))
    return np.array(faces, np.int64).reshape(-1, 3), np.array(owner, np.int64)


def triangulated(vertices: np.ndarray, polygon: Sequence[int]) -> list[tuple[int, int, int]]:
    """Triangles of one polygon, convex or not, given by its corners' indices in turn; its edges stay edges.

    The polygon is cut in the plane that fits it best. Corners that name no vertex are left for the caller to refuse.
    """
    from manifold3d import triangulate

    corners = list(polygon)
    if min(corners) < 0 or max(corners) >= len(vertices):
        return [(corners[0], corners[i], corners[i + 1]) for i in range(1, len(corners) - 1)]
    points = vertices[corners] - vertices[corners].mean(axis=0)
    with np.errstate(all="ignore"):
        points = points / np.abs(points).max()
        normal = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)  # Newell's
        normal /= np.linalg.norm(normal)
    if len(corners) == 4 or not np.isfinite(normal).all():
        return _quad_or_fan(corners, points, normal)
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first /= np.linalg.norm(first)
    flat = points @ np.column_stack([first, np.cross(normal, first)])
    return [(corners[a], corners[b], corners[c]) for a, b, c in triangulate([flat]).tolist()]


def _quad_or_fan(corners: list[int], points: np.ndarray, normal: np.ndarray) -> list[tuple[int, int, int]]:
    """Four corners are cut from the one that looks inward, where there is one; what has no plane is a fan."""
    start = 0
    if len(corners) == 4 and np.isfinite(normal).all():
        behind, ahead = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
        bends = np.cross(behind, ahead) @ normal
        start = int(bends.argmin() % 2) if bends.min() < 0 else 0
    turned = corners[start:] + corners[:start]
    return [(turned[0], turned[i], turned[i + 1]) for i in range(1, len(turned) - 1)]
