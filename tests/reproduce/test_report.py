"""The report: self-contained, plain about scale and training, complete, the same bytes from the same data."""

from __future__ import annotations

import html.parser
import re

import pytest

from reproduce.artefacts import make
from reproduce.plan import FIGURES, TABLES


def build(world, out):
    for name in (*TABLES, *FIGURES, "claims", "report"):
        if name in TABLES:
            outputs = [out / "tables" / f"{name}.{suffix}" for suffix in ("csv", "tex")]
        elif name in FIGURES:
            outputs = [out / "figures" / f"{name}.{suffix}" for suffix in ("png", "svg", "csv")]
        else:
            outputs = [out / "claims.csv"] if name == "claims" else [out / "report" / "index.html"]
        make(name, world.results, outputs)
    return (out / "report" / "index.html").read_text()


class Page(html.parser.HTMLParser):
    """Tags that were opened and not closed, and addresses outside the page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.outside: list[str] = []
        self.images = 0
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        if tag == "img":
            self.images += 1
        if tag not in ("img", "meta", "br", "link"):
            self.open.append(tag)
        for name, value in attributes:
            if name in ("src", "href") and not value.startswith(("data:", "#")):
                self.outside.append(value)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def page(paper_world, tmp_path_factory):
    return build(paper_world, tmp_path_factory.mktemp("report"))


def test_it_is_one_sound_page_with_everything_inside(page):
    parsed = Page(page)
    assert parsed.open == [] and parsed.outside == []
    assert parsed.images == len(FIGURES)
    assert "<script" not in page and "url(" not in page


def test_it_states_scale_and_steps_of_every_agent(page, paper_world):
    text = re.sub(r"<[^>]+>", " ", page)
    assert "All of these agents are barely trained" in text and "scale" in text
    for name in paper_world.runs:
        assert name in text
    assert text.count("123 k") >= len(paper_world.runs)


def test_it_shows_every_claim_with_its_verdict(page):
    assert len(re.findall(r'class="tag (reproduced|not-reproduced|not-measured)"', page)) == 16


def test_same_data_same_page(page, paper_world, tmp_path):
    assert build(paper_world, tmp_path) == page


def test_a_world_without_agents_says_so(world, tmp_path):
    world.absent("oracle-vec_bps-geometric8")
    text = build(world, tmp_path)
    assert "No agent has been evaluated" in text and "Missing (1): oracle-vec_bps-geometric8-s0" in text
    numbers = re.findall(r'<td class="number">\s*<b>', text)
    assert numbers == []  # no table cell holds a number
