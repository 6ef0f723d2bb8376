"""From closed bodies to one solid: which are solid, which are cavities, decided by whole bodies that lie in others.

Rules, of which none asks for the order of faces or bodies:

1. A body lies in another if no part of it is outside; what lies in no other is outermost, and solid.
2. If an outermost body is inside-out, so is everything that lies in it, and all of it is turned.
3. Then what is inside-out and lies in one solid more than in cavities is a cavity of the smallest solid about it.
4. Anything else that is inside-out can be read in two ways, which are named, and is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from manifold3d import Manifold

from object_sets.csg import to_manifold, union
from object_sets.errors import MeshError
from object_sets.limits import BODIES
from object_sets.mass import signed_volume
from object_sets.topology import Bodies

FLAT = 1e-6  # volume over area to the power of 3/2: with less a body is a sheet and has no inside
INSIDE = 1e-5  # of a body's volume: what may stick out of a body that lies in another


def solid_of(path: Path, bodies: Bodies, repairs: list[str]) -> Manifold:
    """The solid that closed bodies describe; what was turned, united or kept as a cavity is added to ``repairs``.

    Raises:
        MeshError: too many bodies, none with a volume, no manifold, or two readings are possible.
    """
    if len(bodies.faces) > BODIES:
        raise MeshError(
            path, f"consists of {len(bodies.faces)} bodies; allowed are {BODIES}",
            "unite them in a modelling program, or save single bodies",
        )  # fmt: skip
    measures = [_measure(bodies.vertices, faces) for faces in bodies.faces]
    full = [abs(volume) > FLAT * area**1.5 for volume, area in measures]
    if not any(full):
        raise MeshError(path, "is flat: it encloses next to no volume", "give the surface a thickness")
    if not all(full):
        repairs.append(f"left out {len(full) - sum(full)} flat pieces without a volume")
    sheets, signs = [], []
    for faces, (volume, _), kept in zip(bodies.faces, measures, full):
        if kept:
            sheets.append(faces[:, ::-1] if volume < 0 else faces)
            signs.append(-1 if volume < 0 else 1)
    solids = [to_manifold(bodies.vertices, faces) for faces in sheets]
    if any(solid.is_empty() for solid in solids):
        raise MeshError(
            path, "is no manifold surface, or encloses nothing", "repair it in a modelling program"
        )
    return _assembled(path, solids, np.array(signs), repairs)


def _assembled(path: Path, solids: Sequence[Manifold], signs: np.ndarray, repairs: list[str]) -> Manifold:
    holders = containment(solids)
    outermost = np.logical_not(holders.any(axis=1))
    _check_covered(path, solids, signs, outermost)
    turned = np.zeros(len(signs), bool)
    for i in range(len(signs)):
        tops = signs[holders[i] & outermost] if not outermost[i] else signs[[i]]
        if len(set(tops)) > 1:
            raise _undecided(path, solids[i], "lies in two bodies, one of them inside-out", "solid or hollow")
        turned[i] = tops[0] < 0
    signs = np.where(turned, -signs, signs)
    if turned.any():
        repairs.append(f"turned {int(turned.sum())} inside-out {'body' if turned.sum() == 1 else 'bodies'}")
    cavities: dict[int, list[Manifold]] = {}
    for i in np.flatnonzero(signs < 0).tolist():
        around = int(signs[holders[i]].sum())
        if around != 1:
            place, readings = (
                ("a cavity", "a loose solid or part of the cavity")
                if around < 1
                else ("several solids", "filled by the outer or a cavity of all")
            )
            raise _undecided(path, solids[i], f"is inside-out and lies in {place}", readings)
        owner = min(np.flatnonzero(holders[i] & (signs > 0)).tolist(), key=lambda j: solids[j].volume())
        cavities.setdefault(owner, []).append(solids[i])
    kept = np.flatnonzero(signs > 0).tolist()
    solid = union(solids[i] - union(cavities[i]) if i in cavities else solids[i] for i in kept)
    if len(kept) > 1:
        repairs.append(f"united {len(kept)} bodies")
    if (count := len(signs) - len(kept)) > 0:
        repairs.append(f"kept {count} closed {'cavity' if count == 1 else 'cavities'}")
    return solid


def _check_covered(path: Path, solids: Sequence[Manifold], signs: np.ndarray, outermost: np.ndarray) -> None:
    """Refuse an outermost body that several of the other orientation cover together: a cavity of all, or filled."""
    tops = np.flatnonzero(outermost)
    low, high = _boxes(solids)
    for i in tops.tolist():
        meets = (low[i] < high[tops]).all(axis=1) & (low[tops] < high[i]).all(axis=1)
        others = tops[meets & (signs[tops] != signs[i])].tolist()
        if len(others) > 1 and _lies_in(solids[i], union(solids[j] for j in others)):
            raise _undecided(
                path, solids[i], "is turned against bodies that cover it together", "filled or hollow"
            )


def _undecided(path: Path, body: Manifold, what: str, readings: str) -> MeshError:
    low, high = np.array(body.bounding_box()).reshape(2, 3)
    place = ", ".join(f"{value:.4g}" for value in (low + high) / 2.0)
    return MeshError(
        path, f"can be read in two ways: a body about ({place}) {what}, so it is {readings}",
        "turn its faces, unite the bodies, or leave it out, in a modelling program",
    )  # fmt: skip


def containment(solids: Sequence[Manifold]) -> np.ndarray:
    """(N, N) bool: whether solid i lies in solid j, in no part outside. Of equal ones the later lies in the earlier."""
    low, high = _boxes(solids)
    volumes = np.array([solid.volume() for solid in solids])
    result = np.zeros((len(solids), len(solids)), bool)
    for i in range(len(solids)):
        slack = INSIDE * (high[i] - low[i]).max()
        fits = (low <= low[i] + slack).all(axis=1) & (high >= high[i] - slack).all(axis=1)
        fits &= volumes >= (1.0 - INSIDE) * volumes[i]
        fits[i] = False
        for j in np.flatnonzero(fits).tolist():
            result[i, j] = not result[j, i] and _lies_in(solids[i], solids[j])
    return result


def pieces(solid: Manifold) -> list[Manifold]:
    """The connected parts of a solid, each with its cavities."""
    parts = solid.decompose()
    bodies = [part for part in parts if part.volume() > 0]
    shells = [_inverted(part) for part in parts if part.volume() < 0]
    if not shells or len(bodies) == 1:
        return [solid] if len(bodies) == 1 else bodies
    holders = containment([*bodies, *shells])[len(bodies) :, : len(bodies)]
    volumes = np.array([body.volume() for body in bodies])
    for shell, holder in zip(shells, holders):
        owner = int(np.where(holder, volumes, np.inf).argmin())
        bodies[owner] = bodies[owner] - shell
    return bodies


def _inverted(solid: Manifold) -> Manifold:
    mesh = solid.to_mesh64()
    return to_manifold(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts)[:, ::-1])


def _lies_in(inner: Manifold, outer: Manifold) -> bool:
    return (inner - outer).volume() <= INSIDE * inner.volume()


def _boxes(solids: Sequence[Manifold]) -> tuple[np.ndarray, np.ndarray]:
    boxes = np.array([solid.bounding_box() for solid in solids]).reshape(-1, 2, 3)
    return boxes[:, 0], boxes[:, 1]


def _measure(vertices: np.ndarray, faces: np.ndarray) -> tuple[float, float]:
    """Signed volume and area of a closed surface."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0
    return signed_volume(vertices, faces), float(area)
