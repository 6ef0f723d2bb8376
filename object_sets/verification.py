"""Measure again what a manifest says of its objects: a set from elsewhere need not be believed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from object_sets.decomposition import is_convex
from object_sets.errors import DataError, MeshError
from object_sets.manifest import MANIFEST_NAME, Entry, Manifest
from object_sets.objects import Object
from object_sets.quality import part_errors
from object_sets.repair import check_sound
from object_sets.sets import nominal_objects
from object_sets.soundness import surface


def verify(place: str | Path) -> int:
    """Verify a set made by ``build`` or ``sample`` and return the number of its objects, sizes not counted.

    Digests, closed outward surfaces, extents, volume, centre of mass, inertia, convexity, parts and their errors.

    Raises:
        DataError: something is altered, or not as the manifest says; the message names object and figure.
    """
    directory = Path(place).parent if Path(place).name == MANIFEST_NAME else Path(place)
    file = directory / MANIFEST_NAME
    if not file.is_file():
        raise DataError(f"{file}: missing")
    manifest = Manifest.from_bytes(file.read_bytes(), file)
    for entry, item in zip(manifest.objects, nominal_objects(manifest, directory), strict=True):
        _verify(file, entry, item)
    return len(manifest.objects)


def _verify(file: Path, entry: Entry, item: Object) -> None:
    try:
        surface(item.vertices, item.faces, entry.name)
        check_sound(Path(entry.file), item.vertices, item.faces)
    except MeshError as error:
        raise DataError(f"{file}: object {entry.name!r} {error.defect}") from error
    convex = is_convex(item.vertices, item.volume)
    errors = part_errors(item.vertices, item.faces, item.parts, entry.decomposition.seed)
    told_and_found = {
        "vertices": (entry.vertices, len(item.vertices)),
        "faces": (entry.faces, len(item.faces)),
        "extents": (entry.extents, item.extents),
        "volume": (entry.volume, item.volume),
        "center_of_mass": (entry.center_of_mass, item.center_of_mass),
        "inertia": (entry.inertia, item.inertia),
        "convexity": (entry.convexity == "convex", convex),
        "corners of the parts": ([p.corners for p in entry.parts], [len(p) for p in item.parts]),
        **{f"errors.{key}": (getattr(entry.errors, key), value) for key, value in errors._asdict().items()},
    }
    for key, (told, found) in told_and_found.items():
        if not np.allclose(told, found, rtol=1e-5, atol=1e-7):
            raise DataError(f"{file}: object {entry.name!r}: {key} is said to be {told}, measured is {found}")
