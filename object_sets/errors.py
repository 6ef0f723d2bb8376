"""Errors of this package. All are ``ValueError``; the message names the place, the value and the remedy."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class ObjectSetError(ValueError):
    """Base of every error this package raises on purpose."""


class UnknownObjectError(ObjectSetError, LookupError):
    """No object, set or directory has this name."""


class ScaleError(ObjectSetError):
    """Scale factors or extents that no object can take."""


class DataError(ObjectSetError):
    """Prepared data that is missing, altered or of an unknown schema."""


class MeshError(ObjectSetError):
    """A mesh that can't become an object.

    Attributes:
        file: the file or shape it came from.
        defect: what is wrong with it.
        remedy: what its author can do.
    """

    def __init__(self, file: object, defect: str, remedy: str) -> None:
        super().__init__(f"{file}: {defect}; remedy: {remedy}")
        self.file, self.defect, self.remedy = str(file), defect, remedy

    def __reduce__(self) -> tuple:
        return type(self), (self.file, self.defect, self.remedy)


class DecompositionError(MeshError):
    """CoACD failed, ran out of time or memory, or its parts can't stand for the mesh."""


def nearest(name: object, valid: Iterable[str]) -> str:
    """'; nearest valid name: X' or the list of valid names, to end an error message with."""
    names = sorted(valid)
    close = difflib.get_close_matches(str(name), names, n=1, cutoff=0.5)
    return f"; nearest valid name: {close[0]!r}" if close else f"; valid names: {', '.join(names)}"
