"""The encodings by name; a new one is one line here and one file beside it, or one entry point of another package."""

from __future__ import annotations

from importlib.metadata import entry_points

from tactile_kit.errors import nearest
from tactile_kit.shape.base import Encoding
from tactile_kit.shape.bps import BPS
from tactile_kit.shape.mesh import Mesh
from tactile_kit.shape.none import NoShape
from tactile_kit.shape.pointnet import PointNet
from tactile_kit.shape.pos import Pos
from tactile_kit.shape.pos_rot import PosRot
from tactile_kit.shape.tables import MeshTable
from tactile_kit.shape.vec_bps import VecBPS

GROUP = "tactile_kit.encodings"  # entry points, ``name = module:Class``
ENCODINGS: dict[str, type[Encoding]] = {
    kind.name: kind for kind in (VecBPS, BPS, PointNet, PosRot, Mesh, Pos, NoShape)
}


def names() -> list[str]:
    """All there are: those of this package, then those that others register."""
    return list(dict.fromkeys([*ENCODINGS, *(point.name for point in entry_points(group=GROUP))]))


def kind_of(name: str) -> type[Encoding]:
    """The class of that name. Raises ValueError: none has it (the nearest is named), or it can't be loaded."""
    if name in ENCODINGS:
        return ENCODINGS[name]
    for point in entry_points(group=GROUP):
        if point.name == name:
            try:
                kind = point.load()
            except (ImportError, AttributeError) as error:
                raise ValueError(f"encoding {name!r} ({point.value}) can't be loaded: {error}") from error
            if getattr(kind, "name", None) != name:
                raise ValueError(
                    f"encoding {name!r} ({point.value}) has name {getattr(kind, 'name', None)!r}"
                )
            return kind
    raise ValueError(f"unknown encoding {name!r}{nearest(name, names())}")


def encoding(name: str, meshes: MeshTable) -> Encoding:
    """The encoding of that name over these meshes. Raises ValueError as ``kind_of``."""
    return kind_of(name)(meshes)
