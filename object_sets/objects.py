"""What the rest of the project knows of an object: a watertight mesh, its convex parts, and what follows from them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import overload

import numpy as np

from object_sets.errors import MeshError, ObjectSetError, ScaleError, UnknownObjectError, nearest
from object_sets.mass import MassProperties, mass_properties


@dataclass(frozen=True, eq=False)
class Object:
    """One object in its canonical pose, SI units. Arrays are read-only.

    The bounding box is centred on the origin unless its set was built with another centre.

    ``mass`` is the nominal mass in kg where it is known (the apple's 0.068), else None; it belongs to the object, not
    to its volume, so scaling leaves it. ``parts`` are the corners of the convex hulls that stand for the solid in the
    simulation; a convex object has one. Two objects are equal when their content is (``digest``).
    """

    id: int
    name: str
    vertices: np.ndarray  # (V, 3) float64, m
    faces: np.ndarray  # (F, 3) int32, counter-clockwise seen from outside
    parts: tuple[np.ndarray, ...]  # each (n, 3) float64, m
    convex: bool
    source: str
    licence: str
    mass: float | None = None

    def __post_init__(self) -> None:
        vertices = _frozen(self.vertices, np.float64)
        faces = _frozen(self.faces, np.int32)
        if not np.isfinite(vertices).all():
            raise MeshError(self.name, "vertices are not all finite", "export the mesh again")
        if len(faces) == 0 or faces.min() < 0 or faces.max() >= len(vertices):
            raise MeshError(
                self.name, f"face indices outside 0..{len(vertices) - 1}", "export the mesh again"
            )
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "parts", tuple(_frozen(part, np.float64) for part in self.parts))

    @cached_property
    def extents(self) -> np.ndarray:
        """(3,) float64, m: the sides of the bounding box."""
        return _frozen(np.ptp(self.vertices, axis=0), np.float64, rows=False)

    @cached_property
    def mass_properties(self) -> MassProperties:
        """Of the solid inside the mesh (not of the parts), for a mass of 1 kg."""
        return mass_properties(self.vertices, self.faces)

    @property
    def volume(self) -> float:
        """m^3, of the solid inside the mesh."""
        return self.mass_properties.volume

    @property
    def center_of_mass(self) -> np.ndarray:
        """(3,) float64, m, from the origin of the canonical frame."""
        return self.mass_properties.center_of_mass

    @property
    def inertia(self) -> np.ndarray:
        """(3, 3) float64, kg m^2 of a mass of 1 kg, about the centre of mass, axes of the canonical frame."""
        return self.mass_properties.inertia

    @cached_property
    def digest(self) -> str:
        """Hash of mesh and parts (hex, 32 digits); the name does not enter."""
        return content_digest(self.vertices, self.faces, *self.parts)

    def scaled(self, factors: Sequence[float] | np.ndarray | float) -> Object:
        """The object stretched along its own axes; parts stay convex, so they are stretched with it.

        Args:
            factors: (3,) or one number, finite and > 0.

        Raises:
            ScaleError: a factor is not positive and finite.
        """
        scale = _three(factors, "scale factors")
        if np.array_equal(scale, np.ones(3)):
            return self
        return replace(self, vertices=self.vertices * scale, parts=tuple(part * scale for part in self.parts))

    def with_extents(self, extents: Sequence[float] | np.ndarray | float) -> Object:
        """The object stretched along its own axes to ``extents`` (3,) or one number for all axes, m, > 0."""
        return self.scaled(_three(extents, "extents") / self.extents)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Object) and (self.id, self.name, self.digest) == (
            other.id,
            other.name,
            other.digest,
        )

    def __hash__(self) -> int:
        return hash((self.id, self.name, self.digest))

    def __repr__(self) -> str:
        size = " x ".join(f"{1000 * e:.1f}" for e in self.extents)
        return f"<Object {self.id} {self.name}: {size} mm, {len(self.faces)} faces, {len(self.parts)} parts>"


@dataclass(frozen=True)
class ObjectSet(Sequence[Object]):
    """Objects in order, found by position (int, slice) or by name (str)."""

    name: str
    objects: tuple[Object, ...]

    @overload
    def __getitem__(self, key: int | str) -> Object: ...
    @overload
    def __getitem__(self, key: slice) -> ObjectSet: ...
    def __getitem__(self, key: int | str | slice) -> Object | ObjectSet:
        if isinstance(key, slice):
            return ObjectSet(self.name, self.objects[key])
        if not isinstance(key, str):
            return self.objects[key]
        for candidate in self.objects:
            if candidate.name == key:
                return candidate
        names = [candidate.name for candidate in self.objects]
        raise UnknownObjectError(f"object {key!r} is not in set {self.name!r}{nearest(key, names)}")

    def __len__(self) -> int:
        return len(self.objects)

    def __iter__(self) -> Iterator[Object]:
        return iter(self.objects)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the objects, in order."""
        return tuple(candidate.name for candidate in self.objects)


def content_digest(*arrays: np.ndarray) -> str:
    """blake2s of the arrays' types, shapes and little-endian bytes: 32 hex digits."""
    state = hashlib.blake2s(digest_size=16)
    for array in arrays:
        data = np.ascontiguousarray(array)
        data = data.astype(data.dtype.newbyteorder("<"), copy=False)
        state.update(f"{data.dtype.str}{data.shape}".encode())
        state.update(data.tobytes())
    return state.hexdigest()


def _frozen(array: np.ndarray, dtype: type, rows: bool = True) -> np.ndarray:
    copy: np.ndarray = np.array(array, dtype=dtype, order="C")
    if rows and (copy.ndim != 2 or copy.shape[1] != 3):
        raise ObjectSetError(f"an array of shape {copy.shape}: (n, 3) is needed")
    copy.setflags(write=False)
    return copy


def _three(values: Sequence[float] | np.ndarray | float, what: str) -> np.ndarray:
    try:
        array = np.broadcast_to(np.asarray(values, dtype=np.float64), (3,))
    except (TypeError, ValueError):
        raise ScaleError(f"{what} = {values!r}: one number or three are allowed") from None
    if not (np.isfinite(array).all() and (array > 0).all()):
        raise ScaleError(f"{what} = {values!r}: only finite numbers > 0 are allowed")
    return array
