"""Every link of the documentation leads somewhere: to a file in the checkout, and to a heading in it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [
        *ROOT.glob("*.md"),
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "docs").rglob("*.ipynb"),
        *(ROOT / "results").glob("*.md"),
    ]
)
LINK = re.compile(r"!?\[(?:[^\[\]]|\[[^\]]*\])*\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)")
CODE = re.compile(r"^(```|~~~).*?^\1|`[^`\n]*`", re.MULTILINE | re.DOTALL)


def text_of(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        text = "\n\n".join(
            "".join(cell["source"]) for cell in json.loads(text)["cells"] if cell["cell_type"] == "markdown"
        )
    return text


def anchors(path: Path) -> set[str]:
    """Of the headings, as GitHub and the site make them."""
    text = re.sub(r"^(```|~~~).*?^\1", "", text_of(path), flags=re.MULTILINE | re.DOTALL)
    heads = re.findall(r"^#+\s+(.+?)\s*$", text, re.MULTILINE)
    plain = (re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", head).lower() for head in heads)
    return {re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", head)) for head in plain}


def dead(path: Path) -> list[str]:
    """Targets of ``path`` that are not there."""
    found = []
    for target in LINK.findall(CODE.sub("", text_of(path))):
        if re.match(r"[a-z]+:", target):
            continue  # elsewhere: no test may depend on the network
        name, _, anchor = target.partition("#")
        file = (path.parent / name).resolve() if name else path
        if not file.exists() and file.suffix == ".md":  # a notebook is a page of the site
            file = file.with_suffix(".ipynb")
        if not file.exists() or (anchor and anchor not in anchors(file)):
            found.append(target)
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links(page: Path) -> None:
    assert dead(page) == []


def test_dead_links_are_found(tmp_path: Path) -> None:
    (tmp_path / "other.md").write_text("# A `b` [c](d.md)\n")
    page = tmp_path / "page.md"
    page.write_text(
        "[a](other.md) [b](other.md#a-b-c) [c](no.md) ![d](no.png) [e](other.md#d) [f](https://no.where)\n"
        "`[g](code.md)`\n```\n[h](code.md)\n```\n"
    )
    assert dead(page) == ["no.md", "no.png", "other.md#d"]


def test_every_page_is_in_the_navigation() -> None:
    listed: list[str] = []

    def collect(entries: list) -> None:
        for entry in entries:
            for value in entry.values():
                collect(value) if isinstance(value, list) else listed.append(value)

    collect(yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"])
    pages = {
        page.relative_to(ROOT / "docs").with_suffix(".md").as_posix()
        for page in PAGES
        if ROOT / "docs" in page.parents
    }
    assert len(listed) == len(set(listed)) and set(listed) == pages
