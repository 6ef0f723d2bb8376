"""Films: the viewer's scene, episodes side by side, a verdict at the end."""

from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from tactile_kit.errors import ViewError
from tactile_kit.view import captions
from tactile_kit.view.film import film
from tactile_kit.view.frames import Clip
from tactile_kit.view.look import FACES
from tactile_kit.view.panel import BAD, GOOD, Panel


def close_to(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    return np.abs(picture.astype(int) - colour).max(axis=2) < 12


def test_a_film_shows_episodes_side_by_side(tactile, tmp_path: Path):
    clips = film(tactile, tmp_path / "a.gif", objects="cube", episodes=2, columns=2, size=128, quiet=True)
    assert len(clips) == 2 and all(clip.outcome is not None for clip in clips)
    pictures = imageio.imread(tmp_path / "a.gif")
    assert pictures.shape[1:] == (128, 256, 3)
    longest = max(len(clip.frames) for clip in clips)
    assert longest * 0.5 < len(pictures) <= longest + 15  # GIF writers merge equal neighbours
    for half in (pictures[0][:, :128], pictures[0][:, 128:]):
        hues = half[20:100].astype(int)
        colourful = (hues.max(axis=2) - hues.min(axis=2)) > 60
        assert colourful.sum() > 200


def test_the_panel_tells_angle_error_and_verdict(clip: Clip):
    panel = Panel(clip, 320)
    start, end = panel.picture(0), panel.picture(len(clip.frames))
    for picture, frame in ((start, clip.frames[0]), (end, clip.frames[-1])):
        bar = close_to(picture[274:285], captions.ANGLE).any(axis=0).sum()
        assert bar == pytest.approx(170 * captions.angle_of(clip, frame) / np.pi, abs=4)
        error = close_to(picture[294:305], captions.ERROR).any(axis=0).sum()
        assert error == pytest.approx(170 * captions.error_of(frame) / np.pi, abs=4)
    colour = GOOD if clip.outcome.success else BAD
    assert close_to(end[235:262], colour).sum() > 100 > close_to(start[235:262], colour).sum()


def test_a_film_as_mp4_is_smoother(tactile, tmp_path: Path):
    clips = film(tactile, tmp_path / "a.mp4", objects="cube", size=64, quiet=True)
    pictures = imageio.imread(tmp_path / "a.mp4")
    assert len(pictures) == 3 * (len(clips[0].frames) - 1 + 15)


def test_bad_films_are_refused(tactile, tmp_path: Path):
    with pytest.raises(ViewError, match=r"a\.avi.*\.gif and \.mp4"):
        film(tactile, tmp_path / "a.avi")
    with pytest.raises(ViewError, match="multiples of 16"):
        film(tactile, tmp_path / "a.gif", size=100)
    with pytest.raises(ViewError, match="columns = 0"):
        film(tactile, tmp_path / "a.gif", columns=0)


def test_colours_differ_for_everybody():
    assert len(set(FACES)) == 6
