"""From triangles to one sound solid: repair what is safe, report every repair, refuse the rest with a remedy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from object_sets.errors import MeshError

if TYPE_CHECKING:
    from manifold3d import Manifold

SIMPLIFICATION = 0.01  # of the largest extent: the surface may move by this much at most while simplifying
SHRINKAGE = 0.05  # of the volume: what simplifying may change
HOLE_AREA = 0.02  # of the surface: what filling holes may add
FLATNESS = 1e-3  # mean thickness over largest extent below which a mesh is a sheet, not a solid
GAP = 2e-3  # of the largest extent: bodies no farther apart count as touching
BODIES = 500  # of one file; what consists of more is no single object
PROBES = 96  # points whose winding number is checked


def sound_solid(
    path: Path, vertices: np.ndarray, faces: np.ndarray, max_faces: int, repairs: list[str]
) -> Manifold:
    """One solid of the triangles: vertices (V, 3) any unit, faces (F, 3); what was changed is added to ``repairs``.

    Raises:
        MeshError: no solid that could be made safely; it names ``path``, the defect and the remedy.
    """
    vertices, faces = _clean(path, vertices, faces, repairs)
    vertices, faces = _closed(path, vertices, faces, repairs)
    solid = _solid(path, vertices, faces, repairs)
    return _simplified(path, solid, float(np.ptp(vertices, axis=0).max()), max_faces, repairs)


def _clean(
    path: Path, vertices: np.ndarray, faces: np.ndarray, repairs: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Merge equal vertices, drop faces without corners of their own and repeated faces."""
    size = float(np.ptp(vertices[np.unique(faces)], axis=0).max())
    if size == 0:
        raise MeshError(path, "all its vertices are one point", "export it again")
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    # The same position written once a face or once a texture corner is how files are, not a defect.
    vertices, inverse = np.unique(vertices, axis=0, return_inverse=True)
    faces = inverse.reshape(-1)[faces]
    _, first, inverse = np.unique(
        np.round(vertices / (1e-7 * size)).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    if len(first) < len(vertices):
        repairs.append(f"merged {len(vertices) - len(first)} vertices that lay within rounding of others")
        vertices, faces = vertices[first], inverse.reshape(-1)[faces]
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    if not proper.all():
        repairs.append(f"dropped {int((~proper).sum())} faces with repeated corners")
        faces = faces[proper]
    _, index = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    if len(index) < len(faces):
        repairs.append(f"dropped {len(faces) - len(index)} repeated faces")
        faces = faces[np.sort(index)]
    if len(faces) < 4:
        raise MeshError(path, f"has {len(faces)} proper triangles", "a solid needs at least 4")
    return vertices, faces


def _closed(
    path: Path, vertices: np.ndarray, faces: np.ndarray, repairs: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Turn faces to a common side and close small holes; refuse what stays open."""
    import trimesh

    mesh = trimesh.Trimesh(vertices, faces, process=False)
    uses = np.bincount(trimesh.grouping.unique_rows(mesh.edges_sorted)[1])
    if (uses > 2).any():
        raise MeshError(
            path, f"{int((uses > 2).sum())} edges belong to more than two faces",
            "separate bodies that touch along an edge and remove inner walls",
        )  # fmt: skip
    before = mesh.faces.copy()
    trimesh.repair.fix_winding(mesh)
    turned = int((mesh.faces != before).any(axis=1).sum())
    if turned:
        repairs.append(f"turned {turned} faces to the side of their neighbours")
    missing = int((uses == 1).sum())
    if missing:
        area, count = mesh.area, len(mesh.faces)
        filled = trimesh.repair.fill_holes(mesh)
        if not (filled and mesh.is_watertight) or mesh.area > (1.0 + HOLE_AREA) * area:
            raise MeshError(
                path, f"is open: {missing} edges border a hole", "close it in a modelling program"
            )
        repairs.append(f"closed holes with {missing} border edges by {len(mesh.faces) - count} faces")
        trimesh.repair.fix_winding(mesh)
    if not mesh.is_winding_consistent:
        raise MeshError(
            path, "its faces have no common outside (a one-sided surface)", "model a closed solid"
        )
    return np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64)


def _solid(path: Path, vertices: np.ndarray, faces: np.ndarray, repairs: list[str]) -> Manifold:
    """One solid of all bodies: inside-out ones turned, several united, cavities kept."""
    import trimesh

    from object_sets.csg import to_manifold, union
    from object_sets.quality import winding_numbers

    labels = trimesh.graph.connected_component_labels(
        trimesh.Trimesh(vertices, faces, process=False).face_adjacency, node_count=len(faces)
    )
    if labels.max() >= BODIES:
        raise MeshError(
            path, f"consists of {labels.max() + 1} bodies; allowed are {BODIES}",
            "unite them in a modelling program, or save single bodies",
        )  # fmt: skip
    bodies = [faces[labels == label] for label in range(labels.max() + 1)]
    volumes = [np.einsum("fi,fi->f", *_first_and_normal(vertices, body)).sum() / 6.0 for body in bodies]
    cavities, outer, turned = [], [], 0
    for i, body in enumerate(bodies):
        others = np.vstack([b for j, b in enumerate(bodies) if j != i]) if len(bodies) > 1 else None
        point = vertices[body[0, :1]]
        inner = others is not None and abs(winding_numbers(point, vertices, others)[0]) > 0.5
        if volumes[i] < 0 and inner:
            cavities.append(body[:, ::-1])
        else:
            turned += volumes[i] < 0
            outer.append(body[:, ::-1] if volumes[i] < 0 else body)
    if turned:
        repairs.append(f"turned {turned} inside-out {'body' if turned == 1 else 'bodies'}")
    solids = [to_manifold(vertices, body) for body in outer]
    holes = [to_manifold(vertices, body) for body in cavities]
    if any(item.is_empty() for item in solids + holes):
        raise MeshError(
            path, "is no manifold surface, or encloses nothing", "repair it in a modelling program"
        )
    solid = union(solids)
    if len(outer) > 1:
        repairs.append(f"united {len(outer)} bodies")
    if holes:
        solid = solid - union(holes)
        repairs.append(f"kept {len(holes)} closed cavities")
    _connected(path, solid, repairs)
    low, high = np.array(solid.bounding_box()).reshape(2, 3)
    if 2.0 * solid.volume() < FLATNESS * solid.surface_area() * (high - low).max():
        raise MeshError(path, "is flat: it encloses next to no volume", "give the surface a thickness")
    return solid


def _connected(path: Path, solid: Manifold, repairs: list[str]) -> None:
    """Refuse bodies that lie apart; a gap of rounding size counts as contact and is reported."""
    bodies = [body for body in solid.decompose() if body.volume() > 0]
    low, high = np.array(solid.bounding_box()).reshape(2, 3)
    size = float((high - low).max())
    reached, left, widest = [bodies[0]], bodies[1:], 0.0
    while reached and left:
        body = reached.pop()
        gaps = [body.min_gap(other, 2.0 * GAP * size) for other in left]
        near = [gap <= GAP * size for gap in gaps]
        widest = max([widest, *(gap for gap, close in zip(gaps, near) if close)])
        reached += [other for other, close in zip(left, near) if close]
        left = [other for other, close in zip(left, near) if not close]
    if left:
        raise MeshError(
            path,
            f"has bodies that don't touch ({len(bodies)} bodies, {len(left)} of them apart)",
            "save each body as a file of its own",
        )
    if widest > 0:
        repairs.append(
            f"took {len(bodies)} bodies as one, gaps up to {100 * widest / size:.2g} % of its size"
        )


def _first_and_normal(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a, b, c = (vertices - vertices.mean(axis=0))[faces].transpose(1, 0, 2)
    return a, np.cross(b, c)


def _simplified(path: Path, solid: Manifold, size: float, max_faces: int, repairs: list[str]) -> Manifold:
    count = solid.num_tri()
    if count <= max_faces:
        return solid
    for share in (0.001, 0.002, 0.005, SIMPLIFICATION):
        simple = solid.simplify(share * size)
        if abs(simple.volume() - solid.volume()) > SHRINKAGE * solid.volume():
            raise MeshError(
                path,
                f"has {count} faces and parts too thin to simplify",
                f"simplify it to at most {max_faces}",
            )
        if simple.num_tri() <= max_faces:
            repairs.append(
                f"simplified {count} faces to {simple.num_tri()} (within {100 * share:g} % of its size)"
            )
            return simple
    left = f"{simple.num_tri()} when simplified within {100 * SIMPLIFICATION:g} % of its size"
    raise MeshError(path, f"has {count} faces, and {left}", f"simplify it to at most {max_faces}")


def check_sound(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Winding numbers of points beside the surface must be 0 or 1; anything else means it cuts through itself."""
    from object_sets.quality import sample_surface, winding_numbers

    points = sample_surface(vertices, faces, PROBES, seed=0)
    spread = 0.01 * np.ptp(vertices, axis=0).max() * np.random.default_rng(0).normal(size=points.shape)
    numbers = winding_numbers(points + spread, vertices, faces)
    wrong = np.abs(numbers - np.clip(np.round(numbers), 0, 1)) > 0.01
    if wrong.any():
        raise MeshError(path, "cuts through itself", "unite its pieces in a modelling program")


def check_closed(file: object, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Raise ``MeshError`` unless every edge has one face on each side and the faces point outward."""
    from object_sets.mass import mass_properties

    edges = np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    ahead = edges[:, 0] * len(vertices) + edges[:, 1]
    back = edges[:, 1] * len(vertices) + edges[:, 0]
    if len(np.unique(ahead)) < len(ahead) or not np.array_equal(np.sort(ahead), np.sort(back)):
        raise MeshError(file, "is not a closed surface", "build the set again")
    if mass_properties(vertices, faces).volume <= 0:
        raise MeshError(file, "is inside-out", "build the set again")
