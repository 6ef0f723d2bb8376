"""Films: episodes played again, side by side or one after the other, and drawn with the viewer's scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from randomization import derive
from tactile_kit.errors import ViewError
from tactile_kit.evaluation.schedule import evaluation_task
from tactile_kit.progress import Counter
from tactile_kit.rotations import octahedral
from tactile_kit.task.goals import EpisodeSpec
from tactile_kit.view.episode import Episode
from tactile_kit.view.frames import STEP, Clip
from tactile_kit.view.panel import Panel

# Pictures a control step: a GIF grows with every picture, a film hardly does.
PICTURES = {".gif": 1, ".mp4": 3}
HOLD = 1.5  # s that the verdict stays
MOST_COLUMNS = 6


def film(
    agent: Any,
    path: str | Path,
    *,
    objects: str = "cube",
    episodes: int = 1,
    columns: int = 1,
    seed: int = 0,
    size: int = 320,
    quiet: bool = False,
) -> list[Clip]:
    """Writes a film of the agent turning objects to octahedral goals, and returns what is in it.

    Beside the hand stands the goal; a wire frame is what a tactile agent believes; bars tell angle and error.

    Args:
        agent: what ``tactile_kit.load_agent`` returns, or an agent's directory.
        path: film to write; ``.gif`` or ``.mp4``.
        objects: sets, names or ids; episodes go through them in turn.
        episodes: how many episodes.
        columns: how many play side by side; the others follow.
        seed: of objects' grasps, goals and physics.
        size: edge of a panel in pixels.
        quiet: show no progress.

    Raises:
        ViewError: a suffix other than .gif and .mp4, or a number out of range.
    """
    path = Path(path)
    _check(path)
    if episodes < 1 or not 1 <= columns <= MOST_COLUMNS or not 64 <= size <= 2048 or size % 16:
        raise ViewError(
            f"episodes = {episodes}, columns = {columns}, size = {size}; allowed are >= 1, 1 to {MOST_COLUMNS}, and "
            "multiples of 16 from 64 to 2048"
        )
    from tactile_kit.agents.agent import load_agent

    if isinstance(agent, (str, Path)):
        agent = load_agent(agent)
    clips = play(agent, objects, episodes, seed, quiet)
    draw(clips, path, columns=columns, size=size, quiet=quiet)
    return clips


def draw(
    clips: Sequence[Clip], path: str | Path, *, columns: int = 1, size: int = 320, quiet: bool = False
) -> None:
    """Writes a film of clips that were played; arguments and errors as of :func:`film`."""
    path = Path(path)
    _check(path)
    pictures = _pictures(clips, columns, size, PICTURES[path.suffix], quiet)
    path.parent.mkdir(parents=True, exist_ok=True)
    _write(path, pictures)


def _check(path: Path) -> None:
    if path.suffix not in PICTURES:
        raise ViewError(f"{path}: allowed are films ending in {' and '.join(PICTURES)}")


def play(agent: Any, objects: str, episodes: int, seed: int, quiet: bool = False) -> list[Clip]:
    """The episodes of a film, played."""
    from tactile_kit.task.variants import prepare

    task = evaluation_task(agent.task, objects, seed)
    variants = prepare(task)
    counter, clips = Counter(episodes * task.horizon, unit="steps", label="playing", quiet=quiet), []
    for number in range(episodes):
        child = derive(seed, "film", number)
        goal = octahedral()[1 + child % 23]  # never the identity, where nothing is to be done
        variant = number % len(variants)
        episode = Episode(agent, task, variants, EpisodeSpec(variant, variant, goal, child))
        try:
            while not episode.done:
                episode.step()
                counter.show(number * task.horizon + len(episode.clip.frames) - 1)
        finally:
            episode.close()
        clips.append(episode.clip)
    counter.show(episodes * task.horizon)
    counter.close()
    return clips


def _pictures(
    clips: Sequence[Clip], columns: int, size: int, finer: int, quiet: bool
) -> Iterator[NDArray[np.uint8]]:
    strips = [clips[first : first + columns] for first in range(0, len(clips), columns)]
    lengths = [max(len(clip.frames) for clip in strip) - 1 for strip in strips]
    hold = round(HOLD / STEP)
    total = sum(finer * (length + hold) for length in lengths)
    counter, done = Counter(total, unit="pictures", label="drawing", quiet=quiet), 0
    for strip, length in zip(strips, lengths, strict=True):
        panels = [Panel(clip, size) for clip in strip]
        for number in range(finer * (length + hold)):
            row = [panel.picture(number / finer) for panel in panels]
            row += [np.full_like(row[0], 255)] * (min(columns, len(clips)) - len(row))
            yield np.concatenate(row, axis=1)
            done += 1
            counter.show(done)
    counter.close()


def _write(path: Path, pictures: Iterator[NDArray[np.uint8]]) -> None:
    finer = PICTURES[path.suffix]
    if path.suffix == ".mp4":
        import imageio.v2 as imageio

        with imageio.get_writer(path, fps=finer / STEP, macro_block_size=16, quality=8) as writer:
            for picture in pictures:
                writer.append_data(picture)  # type: ignore[attr-defined]
        return
    from PIL import Image

    # One palette for all: nothing flickers, and what rests costs no bytes.
    images = [Image.fromarray(picture) for picture in pictures]
    palette = images[len(images) // 2].quantize(128, dither=Image.Dither.NONE)
    images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    images[0].save(
        path,
        save_all=True,
        append_images=images[1:],
        duration=round(1000 * STEP / finer),
        loop=0,
        optimize=True,
    )
