"""``object-sets render``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Render:
    """Draw a contact sheet of a set."""

    objects: Annotated[str, tyro.conf.Positional]
    """A set, a comma list of sets, names and ids, or a directory made by `object-sets build`."""
    out: Path = Path("object_sets.png")
    """PNG file to write."""
    svg: Path | None = None
    """SVG file to write as well."""

    def run(self) -> int:
        from object_sets import render_sheet, select

        chosen = select(self.objects)
        render_sheet(chosen, self.out, self.svg)
        print(f"{self.out}: {len(chosen)} objects")
        return 0
