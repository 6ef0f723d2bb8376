"""One panel of a film: the scene with caption, clock, bar of the angle, and the verdict at the end."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from tactile_kit.view import captions
from tactile_kit.view.frames import Clip
from tactile_kit.view.look import Colour
from tactile_kit.view.raster import Camera, draw
from tactile_kit.view.scene import EYE, TARGET, Scene

INK: Colour = (40, 40, 44)
FAINT: Colour = (214, 214, 218)
GOOD: Colour = (0, 130, 95)
BAD: Colour = (190, 60, 0)
RAISED, VIEW = np.array([0.0, 0.0, 0.008]), 0.83  # m, rad: room for the text above the palm


@cache
def font(size: int, bold: bool = False) -> Any:
    """The font that comes with matplotlib."""
    import matplotlib

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name, size)


class Panel:
    """Draws a clip, which must be complete, in ``size`` pixels square."""

    def __init__(self, clip: Clip, size: int) -> None:
        self.clip, self.size = clip, size
        self._scene = Scene(clip)
        self._camera = Camera(EYE, TARGET + RAISED, size, size, VIEW)

    def picture(self, place: float) -> NDArray[np.uint8]:
        """``(size, size, 3)``, at ``place`` in frames; after the end the last frame stays."""
        frame, size = self.clip.at(place), self.size
        image = Image.fromarray(draw(self._scene, self._scene.show(frame), self._camera))
        canvas, unit = ImageDraw.Draw(image), size / 320
        small, large = font(round(11 * unit)), font(round(13 * unit), bold=True)
        left, right = 10 * unit, size - 10 * unit
        canvas.text((left, 6 * unit), captions.held(self.clip), INK, font=large)
        canvas.text((left, 23 * unit), captions.sense(self.clip), INK, font=small)
        canvas.text((right, 22 * unit), f"{frame.time:.1f} s", INK, font=large, anchor="ra")
        goal = self._camera.project(self._scene.above_goal())[:2]
        canvas.text(tuple(goal.tolist()), "goal", INK, font=small, anchor="ms")
        self._bars(canvas, frame, unit)
        verdict = captions.verdict_at(self.clip, frame)
        if verdict:
            colour = GOOD if self.clip.outcome is not None and self.clip.outcome.success else BAD
            canvas.text((right, size - 62 * unit), verdict, colour, font=large, anchor="rs")
        return np.asarray(image)

    def _bars(self, canvas: Any, frame: Any, unit: float) -> None:
        rows = [("to the goal", captions.ANGLE, captions.angle_of(self.clip, frame))]
        error = captions.error_of(frame)
        if error is not None:
            rows.append(("estimate off", captions.ERROR, error))
        small, left, full = font(round(11 * unit)), 92 * unit, self.size - 150 * unit
        for number, (name, colour, value) in enumerate(rows):
            top = self.size - (46 - 20 * number) * unit
            bottom = top + 11 * unit
            canvas.text((10 * unit, (top + bottom) / 2), name, INK, font=small, anchor="lm")
            canvas.rectangle((left, top, left + full, bottom), fill=FAINT)
            canvas.rectangle(
                (left, top, left + full * min(value / captions.WIDEST, 1.0), bottom), fill=colour
            )
            limit = left + full * self.clip.success_angle / captions.WIDEST
            if number == 0:
                canvas.line(
                    (limit, top - 3 * unit, limit, bottom + 3 * unit),
                    fill=GOOD,
                    width=max(1, round(2 * unit)),
                )
            canvas.text(
                (left + full + 6 * unit, (top + bottom) / 2), f"{value:.2f} rad", INK, font=small, anchor="lm"
            )
