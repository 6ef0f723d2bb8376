"""Domain randomisation as data: named distributions with unit and range, presets, and reproducible sampling."""

from randomization.errors import RandomizationError, SeedError
from randomization.streams import derive, stream

__all__ = ["RandomizationError", "SeedError", "derive", "stream"]
