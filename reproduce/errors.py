"""Errors of the pipeline. Mistakes are ``ValueError``; the message names the file, the value and what is allowed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class ReproduceError(ValueError):
    """Something asked of the pipeline that it can't do as asked."""


class ScaleError(ReproduceError):
    """A scale file that can't be used as written."""


class BusyError(ReproduceError):
    """Another run is at work in the same output directory."""


class Stopped(RuntimeError):
    """Training was asked to stop; a checkpoint is there. No error of anyone's, so no ``ReproduceError``."""


def nearest(name: object, valid: Iterable[str]) -> str:
    """'; nearest valid name: X' or the list of valid names, to end an error message with."""
    names = sorted(valid)
    close = difflib.get_close_matches(str(name), names, n=1, cutoff=0.5)
    return f"; nearest valid name: {close[0]!r}" if close else f"; valid names: {', '.join(names)}"
