"""docs/promises.md names tests that exist."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/promises.md"


def test_every_named_test_exists() -> None:
    cells = re.findall(r"^\|[^|]*\| (\[.*) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(cells) > 40
    named = 0
    for cell in cells:
        source = ""
        for link, word in re.findall(r"\]\((\S+)\)|`(\w+)`", cell):
            if link:
                source = (PAGE.parent / link).read_text(encoding="utf-8")
            else:
                named += 1
                assert re.search(rf"^def test_\w*{word}", source, re.MULTILINE), f"{word} in {cell}"
    assert named > 25
