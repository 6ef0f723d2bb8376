"""A replay in one file: a page that opens from disk, without network, with the whole episode in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from object_sets.storage import write_atomic
from tactile_kit.errors import ViewError
from tactile_kit.view import captions
from tactile_kit.view.browser import Drawing, end, serve
from tactile_kit.view.frames import STEP, Clip, Frame
from tactile_kit.view.scene import ASIDE, LAYERS, Scene

SUFFIXES = (".html", ".viser")
BETWEEN = 3  # pictures a control step; those between are for the eye
HOLD = 2.0  # s that the end stays
BOARD = np.array([0.03, 0.06, -0.12])  # of the curves' middle, world frame, m
RIGHT, UP = np.array([0.7071, 0.7071, 0.0]), np.array([0.0, 0.0, 1.0])  # of the board, as the camera sees it
WIDTH, HEIGHT = 0.30, 0.07  # m


def record(clip: Clip, path: str | Path, layers: frozenset[str] = frozenset(LAYERS[:-1])) -> int:
    """Write the clip to ``path``, ``.html`` (a page of its own) or ``.viser`` (for viser's player); returns its bytes.

    Raises:
        ViewError: another suffix.
    """
    path = Path(path)
    check(path)
    server = serve(port=0)
    try:
        drawing, scene = Drawing(server, Scene(clip, layers)), Scene(clip, layers)
        board = _Board(server, clip, scene)
        drawing.show(scene.show(clip.frames[0]))
        board.show(clip.frames[0])
        serializer = server.get_scene_serializer()
        for number in range(1, BETWEEN * (len(clip.frames) - 1) + 1):
            serializer.insert_sleep(STEP / BETWEEN)
            frame = clip.at(number / BETWEEN)
            drawing.show(scene.show(frame))
            if number % BETWEEN == 0:
                board.show(frame)
        serializer.insert_sleep(HOLD)
        content = serializer.as_html().encode() if path.suffix == ".html" else serializer.serialize()
    finally:
        end(server)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, content)
    return len(content)


def check(path: Path) -> None:
    """Raises ViewError for a replay that can't be written under this name."""
    if path.suffix not in SUFFIXES:
        raise ViewError(f"{path}: allowed are replays ending in {' and '.join(SUFFIXES)}")


class _Board:
    """Caption and curves as parts of the scene: a replay has no panel."""

    def __init__(self, server: Any, clip: Clip, scene: Scene) -> None:
        self._scene, self._clip, self._length = server.scene, clip, max(10.0, float(clip.times[-1]))
        corners = np.array([[0, 1], [0, 0], [1, 0]])
        frame = np.stack([self._points(corners[:2]), self._points(corners[1:])])
        self._scene.add_line_segments(
            "/board/axes", frame, colors=(120, 120, 120), thickness=1.5, thickness_units="screen"
        )
        limit = self._points(np.array([[0, 1], [1, 1]]) * [1, clip.success_angle / captions.WIDEST])
        self._scene.add_line_segments(
            "/board/limit", limit[None], colors=(0, 158, 115), thickness=1.0, thickness_units="screen"
        )
        self._label("title", captions.title(clip), ASIDE + 0.20 * UP)
        self._line = self._label("line", "", ASIDE + 0.18 * UP)
        self._verdict = self._label("verdict", "", ASIDE + 0.16 * UP)
        self._label("goal", "goal", scene.above_goal())
        for number, (name, _, _) in enumerate(captions.curves(clip)):
            text = f"{'blue' if number == 0 else 'orange'}: {name}, 0 to 3.14 rad"
            self._label(name, text, BOARD + 0.2 * WIDTH * RIGHT + (HEIGHT - 0.02 - 0.015 * number) * UP)
        self._lines: dict[str, Any] = {}

    def _label(self, name: str, text: str, place: NDArray) -> Any:
        return self._scene.add_label(f"/board/label {name}", text, position=place, anchor="center-center")

    def _points(self, shares: NDArray) -> NDArray[np.float32]:
        """``(N, 2)`` shares of width and height to ``(N, 3)`` m."""
        places = BOARD + np.outer((shares[:, 0] - 0.5) * WIDTH, RIGHT) + np.outer(shares[:, 1] * HEIGHT, UP)
        return places.astype(np.float32)

    def show(self, frame: Frame) -> None:
        self._line.text = captions.line(self._clip, frame)
        self._verdict.text = captions.verdict_at(self._clip, frame)
        count = round(frame.time / STEP) + 1
        if count < 2:
            return
        for name, colour, values in captions.curves(self._clip):
            shares = np.stack([self._clip.times / self._length, values / captions.WIDEST], axis=1)[:count]
            points = self._points(shares)
            segments = np.stack([points[:-1], points[1:]], axis=1)
            if name in self._lines:
                self._lines[name].points = segments
            else:
                self._lines[name] = self._scene.add_line_segments(
                    f"/board/{name}", segments, colors=colour, thickness=2.5, thickness_units="screen"
                )
