"""The report: self-contained, plain about scale and training, complete, the same bytes from the same data."""

from __future__ import annotations

import base64
import html.parser
import json
import re

import pytest

import object_sets
from reproduce.artefacts import make
from reproduce.files import ROOT
from reproduce.inventory import FINGERS, TACTILE
from reproduce.plan import FIGURES, TABLES

THINGS = {thing.id: thing for thing in object_sets.load("all")}


class Page(html.parser.HTMLParser):
    """Tags that were opened and not closed, and addresses outside the page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.outside: list[str] = []
        self.images = 0
        self.anchors: list[str] = []
        self.links: list[str] = []
        self.ids: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        if tag == "img":
            self.images += 1
        if tag not in ("img", "meta", "br", "link"):
            self.open.append(tag)
        for name, value in attributes:
            if name == "src" and not value.startswith("data:"):
                self.outside.append(value)
            if name == "href":
                (self.anchors if value.startswith("#") else self.links).append(value)
            if name == "id":
                self.ids.append(value)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def folder(paper_world, tmp_path_factory):
    out = tmp_path_factory.mktemp("report")
    paper_world.page(out)
    return out


@pytest.fixture(scope="module")
def page(folder):
    return (folder / "report" / "index.html").read_text()


def test_it_is_one_sound_page_with_everything_inside(page):
    parsed = Page(page)
    assert parsed.open == [] and parsed.outside == []
    assert parsed.images == len(FIGURES)
    assert "<script" not in page and "url(" not in page and "<video" not in page  # nobody was filmed


def test_nav_is_in_page_order_and_links_lead_to_files(page, folder):
    parsed = Page(page)
    places = [parsed.ids.index(anchor.removeprefix("#")) for anchor in parsed.anchors]
    assert len(places) == 6 and places == sorted(places)
    assert len(parsed.links) >= 2 * len((*FIGURES, *TABLES)) + 1
    assert all((folder / "report" / link).is_file() for link in parsed.links)


def test_it_opens_with_what_was_reproduced(page):
    lead = re.search(r'<p class="lead" id="verdict">(.*?)</p>', page, re.DOTALL)[1]
    said, not_said = re.sub(r"<[^>]+>", "", lead).split("Not reproduced:")
    assert "Oracle VecBPS 0.97, 0.99, 0.95 (paper 0.97, 0.99, 0.95)" in said
    assert "Estimator VecBPS 0.90, 0.66, 0.90" in said and "claims number 1, 2" in said
    assert "nothing of Table I that was measured" in not_said


def test_an_agent_below_the_paper_is_named(full_world, tmp_path):
    rows = [row for i in range(13) for row in full_world.draw(TACTILE, THINGS[i], 6, 24)]
    full_world.evaluated(TACTILE, "nominal", rows)
    lead = re.search(r'id="verdict">(.*?)</p>', full_world.page(tmp_path), re.DOTALL)[1]
    assert "Estimator VecBPS 0.25, 0.25, 0.25 (paper 0.90, 0.66, 0.90)" in lead.split("Not reproduced:")[1]


def test_steps_and_hours_are_those_of_the_whole_chain(world, tmp_path):
    name = world.run(TACTILE, steps=1_000_000)
    file = world.folder / "agents" / name / "agent.json"
    start = {"from": "before", "steps": 9_000_000, "hours": 2.5}
    file.write_text(json.dumps(json.loads(file.read_text()) | {"warm_start": start}))
    text = re.sub(r"<[^>]+>", "", world.page(tmp_path))
    assert "10 M (1 M)" in text and "2.75 (0.25)" in text


def test_it_states_scale_and_steps_of_every_agent(page, paper_world):
    text = re.sub(r"<[^>]+>", " ", page)
    assert "All of these agents are barely trained" in text and "scale" in text
    for name in paper_world.runs:
        assert name in text
    assert text.count("123 k") >= len(paper_world.runs)


def test_it_shows_every_claim_with_its_verdict(page):
    assert len(re.findall(r'class="tag (reproduced|not-reproduced|not-measured)"', page)) == 16


def test_same_data_same_page(page, paper_world, tmp_path):
    assert paper_world.page(tmp_path) == page


def test_it_shows_an_agent_at_work(world, tmp_path, monkeypatch):
    """A short film of a shipped agent, inside the page, and nothing where there is no agent."""
    short = {"objects": "cube", "episodes": 1, "columns": 1, "seed": 4, "size": 64}
    monkeypatch.setattr("reproduce.artefacts.film.paper_values", lambda name: short)
    table = tmp_path / "report" / "film.csv"
    world.absent(TACTILE)
    make("film", world.results, [table])
    assert table.read_text() == "agent,object,verdict\n" and not table.with_suffix(".mp4").exists()
    agent = ROOT / "results" / "agents" / f"{FINGERS}-s0" / "agent.json"
    world.runs[f"{FINGERS}-s0"] = {"role": FINGERS, "agent": str(agent), "metrics": None}
    make("film", world.results, [table])
    (line,) = table.read_text().splitlines()[1:]
    name, held, verdict = line.split(",")
    assert (name, held) == (f"{FINGERS}-s0", "cube") and verdict
    page = world.page(tmp_path)
    film = re.search(r'<video[^>]* src="data:video/mp4;base64,([^"]+)"', page)[1]
    assert base64.b64decode(film) == (tmp_path / "report" / "film.mp4").read_bytes()
    assert f"cube: {verdict}." in page


def test_a_world_without_agents_says_so(world, tmp_path):
    world.absent("oracle-vec_bps-geometric8")
    text = world.page(tmp_path)
    assert (
        "No agent has been evaluated" in text
        and "Missing (1 of 1 runs)" in text
        and "oracle-vec_bps-geometric8: 0" in text
    )
    numbers = re.findall(r'<td class="number"[^>]*><div>\s*<b>', text)
    assert numbers == []  # no table cell holds a number


OVERFLOWS = """() => [...document.querySelectorAll("main *")].filter(
    e => !e.closest(".picture") && e.getBoundingClientRect().right > innerWidth + 0.5).map(e => e.outerHTML)"""
UNSEEN = """() => [...document.querySelectorAll("td")].filter(
    e => !e.checkVisibility() || e.getBoundingClientRect().width < 30).length"""
BACK = "getComputedStyle(document.body).backgroundColor"


@pytest.mark.parametrize("mode", ["light", "dark"])
@pytest.mark.parametrize("width", [360, 390, 768, 1300])
def test_nothing_overflows_and_every_cell_shows(browser, folder, width, mode):
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=mode)
    try:
        view = context.new_page()
        view.goto((folder / "report" / "index.html").as_uri())
        view.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        assert view.evaluate("document.documentElement.scrollWidth") <= width
        assert view.evaluate(OVERFLOWS) == []
        assert view.evaluate(UNSEEN) == 0
        curves = view.evaluate("document.querySelectorAll('.picture img')[1].getBoundingClientRect().width")
        assert curves >= 600  # px: labels of 7 pt in a figure of 10.5 inch stay legible
        light = sum(map(int, re.findall(r"\d+", view.evaluate(BACK)))) > 3 * 128
        assert light == (mode == "light")
    finally:
        context.close()
