"""Run, pause, step, speed, scrub: a cursor over what was played, which plays on where it ends."""

from __future__ import annotations

from typing import Protocol

from tactile_kit.view.frames import STEP, Clip, Frame

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)


class Source(Protocol):
    """Where frames come from."""

    clip: Clip

    @property
    def done(self) -> bool: ...
    def step(self) -> Frame: ...


class Playback:
    """A cursor over a source's frames.

    Attributes:
        source: plays on when the cursor passes what is there.
        cursor: place in frames, also between two.
        running: whether time passes.
        speed: seconds shown a second.
    """

    def __init__(self, source: Source, running: bool = True, speed: float = 1.0) -> None:
        self.source, self.running, self.speed = source, running, speed
        self.cursor = 0.0

    @property
    def last(self) -> int:
        """Number of the newest frame."""
        return len(self.source.clip.frames) - 1

    @property
    def frame(self) -> Frame:
        """What is under the cursor."""
        return self.source.clip.at(self.cursor)

    @property
    def ended(self) -> bool:
        """Whether the cursor is at the end of an episode that is over."""
        return self.source.done and self.cursor >= self.last

    def advance(self, seconds: float) -> None:
        """Let ``seconds`` of the viewer's time pass."""
        if not self.running:
            return
        goal = self.cursor + self.speed * seconds / STEP
        # Simulation slower than the eye holds the cursor up: it never runs through more than a step a call.
        if goal > self.last and not self.source.done:
            self.source.step()
        self.cursor = min(goal, self.last)
        if self.ended:
            self.running = False

    def step(self) -> None:
        """Pause, and one frame on."""
        self.running = False
        number = int(self.cursor) + 1
        if number > self.last and not self.source.done:
            self.source.step()
        self.cursor = float(min(number, self.last))

    def scrub(self, number: float) -> None:
        """Pause at frame ``number`` of those played."""
        self.running = False
        self.cursor = float(min(max(number, 0), self.last))
