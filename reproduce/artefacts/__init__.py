"""Tables, figures, claims, report: one file each. ``make(results, outputs)`` reads rows and writes the files."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path

from reproduce.errors import ReproduceError
from reproduce.inventory import NEEDS
from reproduce.results import Results
from tactile_kit.errors import nearest


def make(name: str, results: Results, outputs: Sequence[Path]) -> None:
    """Makes the artefact of that name. Raises ``ReproduceError`` for a name that isn't one."""
    if name not in NEEDS:
        raise ReproduceError(f"artefact {name!r} unknown{nearest(name, NEEDS)}")
    importlib.import_module(f"reproduce.artefacts.{name}").make(results, list(outputs))
