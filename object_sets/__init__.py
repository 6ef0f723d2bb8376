"""Objects for simulation: the paper's 16 shapes, any folder of meshes, convex parts, manifests.

Geometry only; this package knows nothing of hands or learning. Nothing heavy is imported until it is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from object_sets.errors import (
    DataError,
    DecompositionError,
    MeshError,
    ObjectSetError,
    ScaleError,
    UnknownObjectError,
)
from object_sets.objects import Object, ObjectSet
from object_sets.sets import SETS, listed, load, select

if TYPE_CHECKING:
    from object_sets.building import build
    from object_sets.decomposition import DecompositionConfig
    from object_sets.exporters import export
    from object_sets.importing import ImportConfig
    from object_sets.limits import Limits
    from object_sets.reading import read_mesh
    from object_sets.rendering import render_sheet
    from object_sets.sampling import sample
    from object_sets.verification import verify

__all__ = [
    "SETS",
    "DataError",
    "DecompositionConfig",
    "DecompositionError",
    "ImportConfig",
    "Limits",
    "MeshError",
    "Object",
    "ObjectSet",
    "ObjectSetError",
    "ScaleError",
    "UnknownObjectError",
    "build",
    "export",
    "listed",
    "load",
    "read_mesh",
    "render_sheet",
    "sample",
    "select",
    "verify",
]

_LAZY = {
    "DecompositionConfig": "decomposition",
    "ImportConfig": "importing",
    "Limits": "limits",
    "build": "building",
    "export": "exporters",
    "read_mesh": "reading",
    "render_sheet": "rendering",
    "sample": "sampling",
    "verify": "verification",
}


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        from importlib import import_module

        return getattr(import_module(f"object_sets.{_LAZY[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
