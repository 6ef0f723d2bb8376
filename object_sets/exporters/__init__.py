"""Write objects in the forms that simulators load, one file a format: ``NAME.files(item, mass)`` gives path and text.

Every format holds the mesh to look at, each convex part as a collision shape of its own, and mass, centre of mass and
inertia of the solid (not of the parts). Lengths in metres, z up, the frame is the object's canonical one.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import numpy as np

from object_sets.errors import ObjectSetError, nearest
from object_sets.mass import DEFAULT_MASS
from object_sets.objects import Object
from object_sets.storage import write_atomic

FORMATS = ("urdf", "mjcf", "usd", "obj")


def export(
    objects: Sequence[Object],
    out: str | Path,
    format: str,
    *,
    mass: float | None = None,
    density: float | None = None,
) -> list[Path]:
    """Write each object into a folder ``out/NAME`` and return the main files in order. Same objects, same bytes.

    Args:
        objects: at least one, with names of their own.
        format: "urdf", "mjcf", "usd" or "obj".
        mass: kg of every object; or ``density``: kg/m^3 of the solid. By default the object's own mass, and
            ``DEFAULT_MASS`` where it has none.

    Raises:
        ObjectSetError: an unknown format, no objects, names that repeat, mass or density out of range.
    """
    if format not in FORMATS:
        raise ObjectSetError(f"format = {format!r}{nearest(format, FORMATS)}")
    if mass is not None and density is not None:
        raise ObjectSetError(f"mass = {mass!r}, density = {density!r}: at most one of them is allowed")
    for key, value in (("mass", mass), ("density", density)):
        if value is not None and not 0 < value < np.inf:
            raise ObjectSetError(f"{key} = {value!r}: a finite number > 0 is needed")
    names = [item.name for item in objects]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice or not names:
        raise ObjectSetError(f"objects to export: {'names repeat: ' + ', '.join(twice) if twice else 'none'}")
    writer = import_module(f"object_sets.exporters.{format}")
    written = []
    for item in objects:
        known = DEFAULT_MASS if item.mass is None else item.mass
        kilograms = mass if mass is not None else density * item.volume if density is not None else known
        folder = Path(out) / item.name
        files: dict[str, str] = writer.files(item, kilograms)
        for name, text in files.items():
            write_atomic(folder / name, text.encode())
        written.append(folder / next(iter(files)))  # the main file comes first
    return written


def about(item: Object) -> str:
    """One line for the head of a file, safe inside the comments of every format."""
    text = f"{item.name}; source: {item.source}; licence: {item.licence}; digest: {item.digest}"
    clean = "".join(character if character.isprintable() else " " for character in text)
    while "--" in clean:
        clean = clean.replace("--", "- ")
    return clean.replace('"', "'").replace("\\", "/")


def number(*values: float) -> str:
    """Numbers with nine significant digits, separated by spaces; what is rounding (below 1e-15) is zero."""
    return " ".join(f"{0.0 if abs(value) < 1e-15 else value:.9g}" for value in values)
