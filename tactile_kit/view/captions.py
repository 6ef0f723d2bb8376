"""What is said beside the picture, for page, replay and film alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_kit.rotations import geodesic
from tactile_kit.view.frames import STEP, Clip, Frame
from tactile_kit.view.look import Colour

ANGLE: Colour = (0, 114, 178)  # of the curve of the angle to the goal
ERROR: Colour = (213, 94, 0)  # of the estimate's error
WIDEST = np.pi  # rad, no angle is larger


def angle_of(clip: Clip, frame: Frame) -> float:
    """Angle to the goal at a frame, rad."""
    return float(geodesic(frame.truth.rotation, clip.goal))


def error_of(frame: Frame) -> float | None:
    """Error of the estimated orientation, rad; None without an estimate."""
    return None if frame.estimate is None else float(geodesic(frame.estimate.rotation, frame.truth.rotation))


def held(clip: Clip) -> str:
    """The object, and the mesh given where it is another."""
    name = clip.held.name
    return name if clip.given == clip.held else f"{name}, told {clip.given.name}"


def title(clip: Clip) -> str:
    """Who turns what."""
    return f"{clip.agent}: {held(clip)}"


def sense(clip: Clip) -> str:
    """What the agent is told of the object."""
    blind = bool(clip.frames) and clip.frames[0].estimate is not None
    return "blindfolded: it feels its joints alone" if blind else "it is told the true pose"


def line(clip: Clip, frame: Frame) -> str:
    """Clock, angle and error of a frame."""
    text = f"{frame.time:4.1f} s · to the goal {angle_of(clip, frame):.2f} rad"
    error = error_of(frame)
    return text if error is None else f"{text} · estimate off {error:.2f} rad"


def verdict_at(clip: Clip, frame: Frame) -> str:
    """How it ended, at the end; empty before."""
    return clip.verdict() if clip.frames and frame.time >= clip.frames[-1].time - STEP / 2 else ""


def curves(clip: Clip) -> list[tuple[str, Colour, NDArray[np.float64]]]:
    """Name, colour and values ``(N,)`` rad of each curve over ``clip.times``."""
    found = [("angle to the goal", ANGLE, clip.angles)]
    errors = clip.errors
    return found if errors is None else [*found, ("estimate's error", ERROR, errors)]
