"""From triangles to one sound solid: repair what is safe, report every repair, refuse the rest with a remedy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from object_sets.errors import MeshError

if TYPE_CHECKING:
    from manifold3d import Manifold

    from object_sets.parsing import Triangles

SIMPLIFICATION = 0.01  # of the largest extent: the surface may move by this much at most while simplifying
SHRINKAGE = 0.05  # of the volume: what simplifying may change
FLATNESS = 1e-3  # mean thickness over largest extent below which a mesh is a sheet, not a solid
GAP = 2e-3  # of the largest extent: bodies no farther apart count as touching
PROBES = 96  # points whose winding number is checked


def sound_solid(path: Path, triangles: Triangles, max_faces: int, repairs: list[str]) -> Manifold:
    """One solid of a file's triangles, in its unit; what was changed is added to ``repairs``.

    Raises:
        MeshError: no solid that could be made safely; it names ``path``, the defect and the remedy.
    """
    from object_sets.nesting import solid_of
    from object_sets.topology import closed_bodies

    bodies = closed_bodies(path, triangles.vertices, triangles.faces, triangles.groups, repairs)
    return _checked(path, solid_of(path, bodies, repairs), max_faces, repairs)


def remeshed_solid(
    path: Path, triangles: Triangles, max_faces: int, reason: str, repairs: list[str]
) -> Manifold:
    """One solid around a file's triangles, whatever their state; ``reason`` is why they are no solid themselves.

    Raises:
        MeshError: as ``sound_solid``, of the new surface.
    """
    from object_sets.remeshing import CELLS, remeshed

    for cells in CELLS:
        said: list[str] = []
        solid = remeshed(path, triangles.vertices, triangles.faces, cells, reason, said)
        try:
            checked = _checked(path, solid, max_faces, said)
        except MeshError:
            if cells == CELLS[-1]:
                raise
        else:
            repairs += said
            return checked
    raise AssertionError("no grid")


def _checked(path: Path, solid: Manifold, max_faces: int, repairs: list[str]) -> Manifold:
    """In one piece, thick enough, with few enough faces."""
    _connected(path, solid, repairs)
    size = _size(solid)
    if 2.0 * solid.volume() < FLATNESS * solid.surface_area() * size:
        raise MeshError(path, "is flat: it encloses next to no volume", "give the surface a thickness")
    return _simplified(path, solid, size, max_faces, repairs)


def _size(solid: Manifold) -> float:
    low, high = np.array(solid.bounding_box()).reshape(2, 3)
    return float((high - low).max())


def _connected(path: Path, solid: Manifold, repairs: list[str]) -> None:
    """Refuse bodies that lie apart; a gap of rounding size counts as contact and is reported."""
    from object_sets.nesting import pieces

    bodies, size = pieces(solid), _size(solid)
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


def _simplified(path: Path, solid: Manifold, size: float, max_faces: int, repairs: list[str]) -> Manifold:
    count = solid.num_tri()
    if count <= max_faces:
        return solid
    for share in (0.001, 0.002, 0.0035, 0.005, 0.007, SIMPLIFICATION):
        simple = solid.simplify(share * size)
        if abs(simple.volume() - solid.volume()) > SHRINKAGE * solid.volume():
            raise MeshError(
                path,
                f"has {count} faces and parts too thin to simplify",
                f"simplify it to at most {max_faces}",
            )
        if simple.num_tri() <= max_faces:
            within = f"within {100 * share:g} % of its size"
            repairs.append(
                f"simplified {count} faces to {simple.num_tri()} ({within}; {_lost(solid, simple)})"
            )
            return simple
    left = f"{simple.num_tri()} when simplified within {100 * SIMPLIFICATION:g} % of its size"
    raise MeshError(path, f"has {count} faces, and {left}", f"simplify it to at most {max_faces}")


def _lost(before: Manifold, after: Manifold) -> str:
    """What simplifying changed, for people: volume, which is mass at a density, and moments of inertia at a mass."""
    from object_sets.mass import mass_properties

    meshes = [solid.to_mesh64() for solid in (before, after)]
    old, new = (
        mass_properties(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts, np.int64))
        for mesh in meshes
    )
    moments = np.linalg.eigvalsh(new.inertia) / np.linalg.eigvalsh(old.inertia) - 1.0
    furthest = moments[np.abs(moments).argmax()]
    return (
        f"volume, and mass at a density, by {100 * (new.volume / old.volume - 1.0):+.2g} %, "
        f"inertia at a mass by up to {100 * furthest:+.2g} %"
    )


def check_sound(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Winding numbers of points beside the surface must be 0 or 1; anything else means it cuts through itself."""
    from object_sets.quality import sample_surface, winding_numbers

    points = sample_surface(vertices, faces, PROBES, seed=0)
    spread = 0.01 * np.ptp(vertices, axis=0).max() * np.random.default_rng(0).normal(size=points.shape)
    numbers = winding_numbers(points + spread, vertices, faces)
    wrong = np.abs(numbers - np.clip(np.round(numbers), 0, 1)) > 0.01
    if wrong.any():
        raise MeshError(
            path, "cuts through itself", "unite its pieces in a modelling program, or have it remeshed"
        )
