"""Errors of the pipeline. Mistakes are ``ValueError``; the message names the file, the value and what is allowed."""

from __future__ import annotations


class ReproduceError(ValueError):
    """Something asked of the pipeline that it can't do as asked."""


class ScaleError(ReproduceError):
    """A scale file that can't be used as written."""


class BusyError(ReproduceError):
    """Another run is at work in the same output directory."""


class Stopped(RuntimeError):
    """Training was asked to stop; a checkpoint is there. No error of anyone's, so no ``ReproduceError``."""
