"""The viewer: an agent's episode in a page of the browser, live."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactile_kit.agents.agent import Agent, load_agent
from tactile_kit.view.browser import LOOPBACK, Drawing, end, serve
from tactile_kit.view.choice import Choice
from tactile_kit.view.controls import Controls
from tactile_kit.view.episode import Episode
from tactile_kit.view.playback import Playback
from tactile_kit.view.scene import LAYERS, Scene

PICTURES = 20  # a second


class Viewer:
    """One episode after the other, in a page.

    Args:
        agent: what ``load_agent`` returns.
        choice: of the first episode.
        host, port: of the page; port 0 takes any that is free.
        running: whether the first episode plays at once.

    Raises:
        ViewError: the address can't be had, or the choice can't be shown; unknown objects, meshes that can't be held
            and faulty randomisations raise the errors of their rooms. All are ``ValueError``.
    """

    def __init__(
        self, agent: Agent, choice: Choice, host: str = LOOPBACK, port: int = 8080, running: bool = True
    ) -> None:
        self.agent, self.choice = agent, choice
        self.layers = frozenset(LAYERS[:-1])
        self.episode = Episode.of(agent, choice)
        self.playback = Playback(self.episode, running)
        try:
            self.server = serve(host, port)
        except BaseException:
            self.episode.close()
            raise
        shown = f"[{host}]" if ":" in host else host
        self.address = f"http://{shown}:{self.server.get_port()}"
        self.controls = Controls(self.server, self, str(agent.directory))
        self._plotted = -1
        self.drawing: Drawing | None = None
        self._draw_anew()

    def begin(self, choice: Choice) -> None:
        """Play another episode; one that can't be made leaves the old one in place."""
        self.controls.tell("preparing …")
        episode = Episode.of(self.agent, choice)
        self.episode.close()
        self.choice, self.episode = choice, episode
        self.playback = Playback(episode, True, self.playback.speed)
        self._draw_anew()

    def load(self, directory: str) -> None:
        """Another agent plays the same episode."""
        before, self.agent = self.agent, load_agent(Path(directory))
        try:
            self.begin(self.choice)
        except ValueError:
            self.agent = before
            raise

    def look(self, layers: frozenset[str]) -> None:
        """Show other layers of the scene."""
        self.layers = layers
        self.scene.layers = layers

    def push(self, force: NDArray[np.float64]) -> None:
        """Push the object, ``force (3,)`` N, during the next step played."""
        self.episode.push(force)

    def tick(self, seconds: float) -> None:
        """Do what was asked for, let time pass, draw."""
        while True:
            try:
                asked = self.controls.asked.get_nowait()
            except queue.Empty:
                break
            self._do(asked)
        self.playback.advance(seconds)
        self._draw()

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Go on until ``until()``, or for ever."""
        last = time.perf_counter()
        while not until():
            now = time.perf_counter()
            # a search for grasps must not count as time shown
            self.tick(min(now - last, 0.2))
            last = now
            time.sleep(max(0.0, 1 / PICTURES - (time.perf_counter() - now)))

    def close(self) -> None:
        """End the page and the episode."""
        end(self.server)
        self.episode.close()

    def _do(self, asked: Callable[[], None]) -> None:
        try:
            asked()
        except ValueError as problem:  # what somebody in the browser got wrong; the show goes on
            for client in self.server.get_clients().values():
                client.add_notification("That can't be shown", str(problem), color="red")

    def _draw_anew(self) -> None:
        if self.drawing is not None:
            self.drawing.remove()
        self.scene = Scene(self.episode.clip, self.layers)
        self.drawing = Drawing(self.server, self.scene)
        self._plotted = -1
        self._draw()

    def _draw(self) -> None:
        assert self.drawing is not None
        self.drawing.show(self.scene.show(self.playback.frame))
        self.controls.show(self.episode.clip, self.playback)
        if self._plotted != self.playback.last:
            self._plotted = self.playback.last
            self.controls.plot(self.episode.clip)
