"""The encodings by name; a new one is one line here and one file beside it."""

from __future__ import annotations

import difflib

from tactile_kit.shape.base import Encoding
from tactile_kit.shape.bps import BPS
from tactile_kit.shape.mesh import Mesh
from tactile_kit.shape.none import NoShape
from tactile_kit.shape.pointnet import PointNet
from tactile_kit.shape.pos import Pos
from tactile_kit.shape.pos_rot import PosRot
from tactile_kit.shape.tables import MeshTable
from tactile_kit.shape.vec_bps import VecBPS

ENCODINGS: dict[str, type[Encoding]] = {
    encoding.name: encoding for encoding in (VecBPS, BPS, PointNet, PosRot, Mesh, Pos, NoShape)
}


def encoding(name: str, meshes: MeshTable) -> Encoding:
    """The encoding of that name over these meshes. Raises ValueError naming the nearest valid name."""
    if name not in ENCODINGS:
        nearest = difflib.get_close_matches(str(name), ENCODINGS, n=1, cutoff=0)
        raise ValueError(
            f"unknown encoding {name!r}: did you mean {nearest[0]!r}? Allowed: {', '.join(ENCODINGS)}"
        )
    return ENCODINGS[name](meshes)
