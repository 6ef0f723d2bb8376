"""Errors of this package, all ``ValueError``: messages name the place, the value and what is allowed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class RandomizationError(ValueError):
    """A randomisation that can't be used as written: unknown names, values out of range, malformed files."""


class SeedError(RandomizationError):
    """A seed or the path of a random stream is not usable."""


def nearest(name: object, valid: Iterable[str]) -> str:
    """'; nearest valid name: X' or the list of valid names, to end an error message with."""
    names = sorted(valid)
    close = difflib.get_close_matches(str(name), names, n=1, cutoff=0.5)
    return f"; nearest valid name: {close[0]!r}" if close else f"; valid names: {', '.join(names)}"
