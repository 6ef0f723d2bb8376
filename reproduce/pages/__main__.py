"""``python -m reproduce.pages docs`` writes the pages; ``make docs`` calls it."""

from __future__ import annotations

import sys
from pathlib import Path

from reproduce.files import write_if_changed
from reproduce.pages import commands, reference

PAGES = {"commands.md": commands.page, "reference.md": reference.page}


def main(folder: Path) -> None:
    """Every page into ``folder``."""
    for name, page in PAGES.items():
        write_if_changed(folder / name, page())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
