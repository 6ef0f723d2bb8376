"""The viewer in a real browser: it loads, it moves, and every control acts."""

import re
import socket
import threading
import time

import pytest

from tactile_kit.errors import ViewError
from tactile_kit.view.choice import Choice
from tactile_kit.view.viewer import Viewer

PATIENCE = 40.0  # s; a picture takes a second where WebGL is software and the machine is busy


class Running:
    """A viewer in a thread, at work until the end of the test."""

    def __init__(self, viewer: Viewer) -> None:
        self.viewer, self._over = viewer, threading.Event()
        self._thread = threading.Thread(target=viewer.run, args=(self._over.is_set,), daemon=True)
        self._thread.start()

    def until(self, condition) -> None:
        end = time.monotonic() + PATIENCE
        while not condition(self.viewer):
            assert self._thread.is_alive(), "the viewer has ended"
            assert time.monotonic() < end
            time.sleep(0.05)

    def close(self) -> None:
        self._over.set()
        self._thread.join(PATIENCE)
        self.viewer.close()


@pytest.fixture
def running(tactile):
    at_work = Running(Viewer(tactile, Choice("cube", goal=9, seed=3), port=0, running=False))
    yield at_work
    at_work.close()


@pytest.fixture
def shown(running: Running, page):
    """The page, loaded."""
    page.set_default_timeout(1000 * PATIENCE)
    page.goto(running.viewer.address)
    page.wait_for_selector("canvas")
    page.get_by_role("button", name="Step", exact=True).wait_for()
    return page


def press(page, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click()


def unfold(page, folder: str) -> None:
    page.get_by_text(folder, exact=True).click()


def agent_field(page):
    # viser's label of a text names another id than the field's own
    return page.locator("xpath=//label[text()='Agent']/following::*[self::input or self::textarea][1]")


def choose(page, label: str, value: str) -> None:
    option = page.get_by_role("option", name=value, exact=True)
    for _ in range(5):  # a folder that is still unfolding takes the list away again
        page.get_by_label(label, exact=True).first.click()
        page.wait_for_timeout(1000)
        if option.is_visible():
            break
    option.click()


@pytest.mark.slow
def test_it_runs_pauses_steps_and_goes_back(running: Running, shown):
    still = shown.locator("canvas").first.screenshot()
    press(shown, "Run")
    running.until(lambda viewer: viewer.playback.last > 5)
    assert shown.locator("canvas").first.screenshot() != still
    press(shown, "Pause")
    running.until(lambda viewer: not viewer.playback.running)
    before = int(running.viewer.playback.cursor)
    press(shown, "Step")
    running.until(lambda viewer: viewer.playback.cursor == before + 1)
    played = running.viewer.playback.last
    slider = shown.get_by_role("slider").first

    def back(viewer: Viewer) -> bool:
        slider.press("Home")  # again where the last step's place reached the page after the key
        return viewer.playback.cursor == 0

    running.until(back)
    assert running.viewer.playback.last == played  # what was played is still there
    choose(shown, "Speed", "4 x")
    running.until(lambda viewer: viewer.playback.speed == 4.0)
    press(shown, "Run")
    running.until(lambda viewer: viewer.playback.ended)
    shown.get_by_text(re.compile("success|not there|dropped")).first.wait_for()
    press(shown, "Run again")
    running.until(lambda viewer: viewer.playback.running)


@pytest.mark.slow
def test_object_mesh_and_goal_are_chosen(running: Running, shown):
    choose(shown, "Object held", "cuboid")
    choose(shown, "Mesh given", "cube")
    choose(shown, "Goal", "10: 90° about z")
    press(shown, "Begin")
    running.until(lambda viewer: viewer.episode.clip.held.name == "cuboid")
    assert running.viewer.episode.clip.given.name == "cube" and running.viewer.choice.goal == 10
    shown.get_by_text("cuboid, told cube").wait_for()


@pytest.mark.slow
def test_layers_pushes_and_terms(running: Running, shown):
    unfold(shown, "Shown")
    shown.get_by_label("Basis points and vectors").check()
    running.until(lambda viewer: "basis" in viewer.layers)
    unfold(shown, "Push the object")
    press(shown, "Push")
    press(shown, "Step")
    running.until(lambda viewer: viewer.playback.last == 1)
    assert running.viewer.episode.clip.frames[1].pushed
    unfold(shown, "Randomisation")
    choose(shown, "Single term", "tip_friction")
    choose(shown, "Taken from", "strong")
    press(shown, "Set the term")
    running.until(lambda viewer: viewer.choice.terms == {"tip_friction": "strong"})
    shown.get_by_text("tip_friction: strong").wait_for()


@pytest.mark.slow
def test_agents_are_loaded_and_unknown_ones_named(running: Running, shown, oracle):
    agent_field(shown).fill("nowhere/at-all")
    press(shown, "Load agent")
    shown.get_by_text("nowhere/at-all").first.wait_for()
    before = running.viewer.agent
    agent_field(shown).fill(str(oracle.directory))
    press(shown, "Load agent")
    running.until(lambda viewer: viewer.agent is not before)
    running.until(lambda viewer: viewer.episode.clip.agent == oracle.directory.name)
    assert running.viewer.episode.clip.errors is None


def test_a_port_in_use_is_named(oracle):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ViewError, match=f"127.0.0.1:{port}: Address already in use"):
            Viewer(oracle, Choice("cube"), port=port)
    with pytest.raises(ViewError, match="allowed are 0 to 65535"):
        Viewer(oracle, Choice("cube"), port=70000)


def test_only_this_machine_is_served(oracle):
    viewer = Viewer(oracle, Choice("cube"), port=0, running=False)
    try:
        listening = viewer.server._websock_server
        assert viewer.address.startswith("http://127.0.0.1:") and listening._host == "127.0.0.1"
    finally:
        viewer.close()
