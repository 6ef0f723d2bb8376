"""The panel beside the scene. What somebody asks for goes into a queue, and the viewer does it between two pictures."""

from __future__ import annotations

import queue
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
import viser

from object_sets import load
from randomization import PRESETS, preset
from tactile_kit.evaluation.schedule import EXTENT_RANGE
from tactile_kit.view import captions
from tactile_kit.view.choice import HELD, Choice
from tactile_kit.view.episode import goal_names
from tactile_kit.view.frames import Clip
from tactile_kit.view.playback import SPEEDS, Playback
from tactile_kit.view.scene import LAYERS

SAME = "the object held"
AS_PRESET = "as the preset"
NUMBER = "a number"
DIRECTIONS = {
    "+x": (1, 0, 0),
    "-x": (-1, 0, 0),
    "+y": (0, 1, 0),
    "-y": (0, -1, 0),
    "+z": (0, 0, 1),
    "-z": (0, 0, -1),
}
BASIS_LAYER = LAYERS[-1]
TITLES = {
    "hand": "Hand",
    "goal": "Goal (ghost beside)",
    "estimate": "Estimate (wire frame)",
    "contacts": "Contacts",
    BASIS_LAYER: "Basis points and vectors",
}


class Owner(Protocol):
    """Who does what the panel asks for."""

    choice: Choice
    layers: frozenset[str]
    playback: Playback

    def begin(self, choice: Choice) -> None: ...
    def load(self, directory: str) -> None: ...
    def look(self, layers: frozenset[str]) -> None: ...
    def push(self, force: Any) -> None: ...


class Controls:
    """The panel.

    Attributes:
        asked: what is to be done, in order; each a call without arguments.
    """

    def __init__(self, server: viser.ViserServer, owner: Owner, agent: str) -> None:
        self.asked: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._gui, self._owner = server.gui, owner
        server.gui.set_panel_label("tactile-kit")
        self.status = server.gui.add_markdown("")
        self._time()
        with server.gui.add_folder("Curves"):
            self._curves_box()
        with server.gui.add_folder("Episode"):
            self._episode(agent)
        with server.gui.add_folder("Shown", expand_by_default=False):
            self._layers()
        with server.gui.add_folder("Push the object", expand_by_default=False):
            self._push()
        with server.gui.add_folder("Randomisation", expand_by_default=False):
            self._randomisation()

    def _on(self, handle: Any, act: Callable[[Any], None]) -> Any:
        """``act`` with the new value when somebody (not the viewer) changes ``handle``."""

        def changed(event: Any) -> None:
            if event.client is not None:
                value = event.target.value
                self.asked.put(lambda: act(value))

        handle.on_update(changed)
        return handle

    def _button(self, label: str, act: Callable[[], None], hint: str | None = None) -> Any:
        button = self._gui.add_button(label, hint=hint)
        button.on_click(lambda _: self.asked.put(act))
        return button

    # -- parts --------------------------------------------------------------------------------------------------------

    def _time(self) -> None:
        play = self._owner.playback
        self._run = self._button("Pause", self._toggle)
        self._button("Step", lambda: self._owner.playback.step(), "One control step of 0.1 s")
        self._button("From the start again", lambda: self._owner.begin(self._owner.choice))
        self._scrub = self._on(
            self._gui.add_slider(
                "Time (s)", 0.0, 10.0, 0.1, initial_value=0.0, hint="Back through what was played"
            ),
            lambda value: self._owner.playback.scrub(10 * value),
        )
        speeds = [f"{speed:g} x" for speed in SPEEDS]
        self._on(
            self._gui.add_dropdown("Speed", speeds, initial_value=f"{play.speed:g} x"),
            lambda value: setattr(self._owner.playback, "speed", float(value.split()[0])),
        )

    def _toggle(self) -> None:
        playback = self._owner.playback
        if playback.ended:
            playback.scrub(0)
        playback.running = not playback.running

    def _curves_box(self) -> None:
        empty = tuple(np.zeros(0) for _ in range(3))
        series: tuple[Any, ...] = (
            {"label": "s"},
            {"label": "angle to the goal", "stroke": _css(captions.ANGLE), "width": 2},
            {"label": "estimate's error", "stroke": _css(captions.ERROR), "width": 2},
        )
        scales: Any = {"x": {"time": False, "range": (0, 10)}, "y": {"range": (0, 3.3)}}
        axes: Any = ({"label": "s"}, {"label": "rad"})
        self._plot = self._gui.add_uplot(empty, series, scales=scales, axes=axes, height=190)

    def _episode(self, agent: str) -> None:
        choice, names = self._owner.choice, [thing.name for thing in load("all")]
        held = names if choice.held in names else [choice.held, *names]
        given = [SAME, *names] if choice.given in ("", *names) else [SAME, choice.given, *names]
        self._held = self._gui.add_dropdown("Object held", held, initial_value=choice.held)
        self._given = self._gui.add_dropdown(
            "Mesh given", given, initial_value=choice.given or SAME, hint="The shape that the agent is told"
        )
        self._goal = self._gui.add_dropdown("Goal", goal_names(), initial_value=goal_names()[choice.goal])
        self._nominal = self._gui.add_checkbox("Nominal size", choice.extents is None)
        low, high = (100 * limit for limit in EXTENT_RANGE)
        self._extents = [
            self._gui.add_slider(
                f"Size {axis} (cm)", low, high, 0.1, initial_value=value, disabled=choice.extents is None
            )
            for axis, value in zip("xyz", choice.extents or (6.0, 6.0, 6.0), strict=True)
        ]
        self._seed = self._gui.add_number("Seed", choice.seed, min=0, step=1)
        self._on(self._nominal, self._lock_sizes)
        self._button("Begin", self._begin, "Play this episode; a new size needs a while for its grasps")
        path = self._gui.add_text(
            "Agent", agent, hint="An agent's directory on the machine that runs the viewer"
        )
        self._button("Load agent", lambda: self._owner.load(path.value))

    def _lock_sizes(self, nominal: bool) -> None:
        for slider in self._extents:
            slider.disabled = nominal

    def _begin(self) -> None:
        given = HELD if self._given.value == SAME else self._given.value
        x, y, z = (float(slider.value) for slider in self._extents)
        self._owner.begin(
            replace(
                self._owner.choice,
                held=self._held.value,
                given=given,
                goal=int(self._goal.value.split(":")[0]),
                extents=None if self._nominal.value else (x, y, z),
                preset=self._preset.value,
                seed=int(self._seed.value),
            )
        )

    def _layers(self) -> None:
        for layer in LAYERS:

            def turn(on: bool, layer: str = layer) -> None:
                layers = self._owner.layers
                self._owner.look(layers | {layer} if on else layers - {layer})

            self._on(self._gui.add_checkbox(TITLES[layer], layer in self._owner.layers), turn)

    def _push(self) -> None:
        direction = self._gui.add_dropdown("Direction", list(DIRECTIONS), initial_value="+x")
        force = self._gui.add_slider(
            "Force (N)", 0.1, 5.0, 0.1, initial_value=1.0, hint="For 0.1 s; an object of 50 g weighs 0.5 N"
        )
        self._button(
            "Push",
            lambda: self._owner.push(force.value * np.array(DIRECTIONS[direction.value], float)),
            "At the next step that is played",
        )

    def _randomisation(self) -> None:
        choice = self._owner.choice
        presets = list(PRESETS) if choice.preset in PRESETS else [choice.preset, *PRESETS]
        self._preset = self._gui.add_dropdown("Preset", presets, initial_value=choice.preset)
        term = self._gui.add_dropdown("Single term", list(preset("default").terms))
        source = self._gui.add_dropdown("Taken from", [AS_PRESET, *PRESETS, NUMBER], initial_value=AS_PRESET)
        number = self._gui.add_number("Number", 0.0, step=0.0001, hint="In the term's unit")
        self._terms = self._gui.add_markdown("")

        def put() -> None:
            terms = dict(self._owner.choice.terms)
            terms.pop(term.value, None)
            if source.value != AS_PRESET:
                terms[term.value] = float(number.value) if source.value == NUMBER else source.value
            changed = replace(self._owner.choice, preset=self._preset.value, terms=terms)
            changed.physics()  # refuses what is out of range
            self._owner.choice = changed
            self._tell_terms()

        self._button("Set the term", put, "For the next episode begun")
        self._tell_terms()

    def _tell_terms(self) -> None:
        terms = self._owner.choice.terms
        self._terms.content = (
            "\n".join(f"- {name}: {value}" for name, value in terms.items()) or "No single terms set."
        )

    # -- what is told -------------------------------------------------------------------------------------------------

    def tell(self, text: str) -> None:
        """Text at the top of the panel."""
        self.status.content = text

    def show(self, clip: Clip, playback: Playback) -> None:
        """Bring clock, button and caption up to date."""
        frame = playback.frame
        with self._gui._websock_interface.atomic():
            label = "Pause" if playback.running else "Run again" if playback.ended else "Run"
            if self._run.label != label:
                self._run.label = label
            clock = round(frame.time, 1)
            if self._scrub.value != clock:
                self._scrub.value = clock
            verdict = captions.verdict_at(clip, frame)
            text = f"**{captions.title(clip)}**\n\n{captions.line(clip, frame)}\n\n**{verdict or '…'}**"
            if self.status.content != text:
                self.status.content = text

    def plot(self, clip: Clip) -> None:
        """Bring the curves up to date."""
        angles, errors = clip.angles, clip.errors
        self._plot.data = (clip.times, angles, np.full(len(angles), np.nan) if errors is None else errors)


def _css(colour: captions.Colour) -> str:
    return f"rgb{colour}"
