"""The cursor over frames that are made on the way; without physics or browser."""

from dataclasses import dataclass

import numpy as np
import pytest

import object_sets
from tactile_kit.view.frames import Clip, Frame, Pose
from tactile_kit.view.playback import Playback


@dataclass
class Ended:
    theta: float = 0.1
    success: bool = True
    drop: bool = False
    fault: str | None = None


class Counted:
    """A source of ``length`` steps."""

    def __init__(self, length: int) -> None:
        cube = object_sets.load("all")["cube"]
        self.length, self.clip = length, Clip("a", cube, cube, np.eye(3), 0.4)
        self._add()

    def _add(self) -> Frame:
        number = len(self.clip.frames)
        at = Pose(np.array([number, 0.0, 0.0]), np.eye(3))
        self.clip.frames.append(Frame(0.1 * number, np.zeros(12), at))
        return self.clip.frames[-1]

    @property
    def done(self) -> bool:
        return self.clip.outcome is not None

    def step(self) -> Frame:
        frame = self._add()
        if len(self.clip.frames) > self.length:
            self.clip.outcome = Ended()
        return frame


def test_time_plays_on_at_the_speed_asked_for():
    playback = Playback(Counted(10), speed=0.5)
    playback.advance(0.1)
    assert playback.cursor == pytest.approx(0.5)
    assert playback.frame.truth.position[0] == pytest.approx(0.5)  # between two frames
    playback.advance(0.1)
    playback.advance(0.1)
    assert playback.cursor == pytest.approx(1.5) and playback.last == 2


def test_it_stops_at_the_end_and_says_so():
    playback = Playback(Counted(3))
    for _ in range(20):
        playback.advance(0.05)
    assert playback.ended and not playback.running and playback.cursor == 3
    assert playback.source.clip.verdict() == "success: 0.10 rad from the goal"


def test_scrubbing_shows_what_was_played_and_simulates_nothing():
    playback = Playback(Counted(10))
    for _ in range(5):
        playback.step()
    playback.scrub(2)
    assert playback.frame.truth.position[0] == 2 and playback.last == 5 and not playback.running
    playback.scrub(99)
    assert playback.cursor == 5 and playback.last == 5  # nothing beyond what was played
    playback.scrub(1)
    playback.step()
    assert playback.cursor == 2 and playback.last == 5


def test_paused_time_stands():
    playback = Playback(Counted(10), running=False)
    playback.advance(5.0)
    assert playback.cursor == 0 and playback.last == 0
