"""Episodes to look at, played once."""

from pathlib import Path

import pytest

from tactile_kit.agents.agent import load_agent
from tactile_kit.view.choice import Choice
from tactile_kit.view.episode import Episode
from tactile_kit.view.frames import Clip

AGENTS = Path(__file__).parents[2] / "results" / "agents"
ORACLE, TACTILE = AGENTS / "oracle-vec_bps-geometric8-s0", AGENTS / "tactile-vec_bps-geometric8-s0"


@pytest.fixture(scope="session")
def tactile():
    return load_agent(TACTILE)


@pytest.fixture(scope="session")
def oracle():
    return load_agent(ORACLE)


def played(agent, choice: Choice, steps: int = 1000) -> Clip:
    episode = Episode.of(agent, choice)
    try:
        while not episode.done and len(episode.clip.frames) <= steps:
            episode.step()
    finally:
        episode.close()
    return episode.clip


@pytest.fixture(scope="session")
def clip(tactile) -> Clip:
    """A tactile agent with a cube, told that it is a cuboid; never changed by a test."""
    return played(tactile, Choice("cube", given="cuboid", goal=9, seed=3))


@pytest.fixture
def page(browser):
    """A new page of the browser, without network but for this machine; what it complains of fails the test."""
    context = browser.new_context(viewport={"width": 1300, "height": 900})
    opened, complaints, asked = context.new_page(), [], []
    opened.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on("request", lambda request: asked.append(request.url))
    yield opened
    context.close()
    assert not complaints
    # nothing is asked of anybody else
    assert all(url.startswith(("http://127.0.0.1:", "file:", "data:", "blob:")) for url in asked), asked
