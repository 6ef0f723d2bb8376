"""The site builds strictly, asks nothing of the network, and its search works from disk."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for module in ("mkdocs", "material", "mkdocstrings", "nbconvert"):
        pytest.importorskip(module, reason="the extra `docs` is not installed")
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(out)]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def test_nothing_is_fetched(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) > 30
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert not re.findall(r"<(?:script|img|iframe)[^>]+src=\"https?:[^\"]*", text), page
        assert not re.findall(r"<link[^>]+rel=\"(?:stylesheet|preconnect)\"[^>]+https?:", text), page


def test_links_that_leave_the_site_hold_beside_it(site: Path) -> None:
    """site/ lies beside docs/ in the checkout."""
    for page in site.rglob("*.html"):
        for target in re.findall(r"href=\"((?:\.\./)+[^\"#]*)", page.read_text(encoding="utf-8")):
            place = (ROOT / "site" / page.relative_to(site)).parent / target
            inside = site / os.path.relpath(os.path.normpath(place), ROOT / "site")
            assert Path(os.path.normpath(place)).exists() or inside.exists(), (page.name, target)


def test_notebooks_are_pages(site: Path) -> None:
    page = (site / "notebooks" / "look_at_an_agent.html").read_text(encoding="utf-8")
    assert "95 % interval" in page and page.count("look_at_an_agent_files/") >= 2
    assert list((site / "notebooks" / "look_at_an_agent_files").glob("*.png"))


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pages_fit_and_ask_nobody(site: Path, browser, scheme: str) -> None:
    context = browser.new_context(color_scheme=scheme)
    page, complaints, asked = context.new_page(), [], []
    page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    names = "index glossary commands differences speed api/tactile_kit notebooks/bring_an_object"
    for name in names.split():
        page.goto((site / f"{name}.html").as_uri())
        for width in (360, 768, 1300):
            page.set_viewport_size({"width": width, "height": 800})
            # the drawer slides away first; what stays too wide runs into the time limit
            page.wait_for_function("document.documentElement.scrollWidth <= innerWidth", timeout=60_000)
            cells = page.evaluate(
                "[...document.querySelectorAll('td')].map(c => c.getBoundingClientRect().right)"
            )
            assert width > 360 or max(cells, default=0) <= width, f"{name} hides columns on a phone"
        ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert (sum(map(int, re.findall(r"\d+", ground)[:3])) < 300) == (scheme == "dark"), ground
    context.close()
    assert not complaints, complaints
    assert all(url.startswith(("file:", "data:", "blob:")) for url in asked), asked


def test_search_works_from_disk(site: Path, browser) -> None:
    page = browser.new_page(viewport={"width": 1300, "height": 800})
    page.goto((site / "api" / "tactile_kit.html").as_uri())
    page.wait_for_selector("iframe", timeout=90_000, state="attached")  # the search's worker is there
    page.click("input[name=query]")  # only now the index is read
    page.keyboard.type("kalman")
    page.wait_for_selector(".md-search-result__item", timeout=90_000, state="attached")
    assert "Kalman" in page.inner_text(".md-search-result__list")
    page.close()
