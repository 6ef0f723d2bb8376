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
from object_sets.sets import SETS, load, select

if TYPE_CHECKING:
    from object_sets.building import build
    from object_sets.decomposition import DecompositionConfig
    from object_sets.rendering import render_sheet

__all__ = [
    "SETS",
    "DataError",
    "DecompositionConfig",
    "DecompositionError",
    "MeshError",
    "Object",
    "ObjectSet",
    "ObjectSetError",
    "ScaleError",
    "UnknownObjectError",
    "build",
    "load",
    "render_sheet",
    "select",
]

_LAZY = {"build": "building", "DecompositionConfig": "decomposition", "render_sheet": "rendering"}


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        from importlib import import_module

        return getattr(import_module(f"object_sets.{_LAZY[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
