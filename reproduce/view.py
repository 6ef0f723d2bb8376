"""The command ``view``: a page in the browser, or a replay in a file."""

from __future__ import annotations

import sys
from pathlib import Path

from tactile_kit.agents.agent import load_agent
from tactile_kit.errors import ViewError
from tactile_kit.view.choice import HELD, Choice


def choice_of(
    objects: str,
    given: str,
    extents: str,
    goal: int,
    randomization: str,
    terms: str,
    seed: int,
) -> Choice:
    """The command's arguments as a choice; raises ``ViewError`` naming the one that is wrong."""
    sizes = None
    if extents:
        try:
            x, y, z = (float(part) for part in extents.split(","))
        except ValueError:
            raise ViewError(
                f"--extents {extents!r}; allowed are three numbers in cm, such as 6,6,9"
            ) from None
        sizes = (x, y, z)
    chosen = Choice(
        objects, HELD if given == "true" else given, sizes, goal, randomization, _terms(terms), seed
    )
    chosen.physics()
    return chosen


def _terms(text: str) -> dict[str, str | float]:
    found: dict[str, str | float] = {}
    for item in filter(None, text.split(",")):
        name, equals, value = item.partition("=")
        if not equals:
            raise ViewError(
                f"--terms {item!r}; allowed are NAME=PRESET and NAME=NUMBER, such as tip_friction=0.5"
            )
        try:
            found[name] = float(value)
        except ValueError:
            found[name] = value
    return found


def view(agent: Path, choice: Choice, host: str, port: int) -> None:
    """Serve the page until Ctrl-C."""
    from tactile_kit.view.viewer import Viewer

    viewer = Viewer(load_agent(agent), choice, host, port)
    print(f"{viewer.address}  (Ctrl-C ends it)", flush=True)
    try:
        viewer.run()
    finally:
        viewer.close()


def record(agent: Path, choice: Choice, path: Path) -> None:
    """Play the episode to its end and write the replay."""
    from object_sets.storage import check_file_writable
    from tactile_kit.view.episode import Episode
    from tactile_kit.view.record import check
    from tactile_kit.view.record import record as write

    check(path)
    check_file_writable(path, "--record")
    episode = Episode.of(load_agent(agent), choice)
    try:
        while not episode.done:
            episode.step()
            print(f"\r{episode.clip.frames[-1].time:4.1f} s", end="", file=sys.stderr, flush=True)
    finally:
        print(file=sys.stderr)
        episode.close()
    size = write(episode.clip, path)
    print(f"{path}: {episode.clip.verdict()}; {size / 1e6:.1f} MB")
