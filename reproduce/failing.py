"""Films of failures, one of each kind, their episodes chosen by rule from an agent's courses."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

from reproduce.errors import ReproduceError
from reproduce.files import require_agent, write_atomic
from reproduce.tracks import tracks

COLUMNS = ("kind", "agent", "object", "goal", "seed", "verdict", "film")


def films_to(
    agent: Path, courses: Path, out: Path, size: int = 192, seed: int = 0, quiet: bool = False
) -> list[dict]:
    """Writes ``<kind>.mp4`` for each kind of failure and the table ``failures.csv`` into ``out``; returns its rows.

    The film of a kind is of the file's first episode that failed so and, played alone, fails so again: rounding differs
    from that of many environments at once, and hands are chaotic. A kind without such an episode has no film.

    Args:
        agent: the agent's directory. courses: its own, as ``reproduce.courses`` writes them.
        size: edge in pixels. seed: of the evaluation that the courses are of.

    Raises:
        ReproduceError: no agent, or an episode of the file that the evaluation of that seed does not have.
    """
    require_agent(agent)
    import torch

    from tactile_kit.agents.agent import load_agent
    from tactile_kit.evaluation.courses import read_courses
    from tactile_kit.evaluation.failures import KINDS, kind_of_moment
    from tactile_kit.view.film import draw

    torch.set_num_threads(1)
    loaded = load_agent(agent)
    found = [track.last for episodes in tracks(read_courses(courses)).values() for track in episodes]
    rows = []
    for kind in KINDS:
        (out / f"{kind}.mp4").unlink(missing_ok=True)
        for last in (one for one in found if kind_of_moment(one) == kind):
            clip, again = _played(loaded, last, courses, seed)
            if again == kind:
                draw([clip], out / f"{kind}.mp4", size=size, quiet=quiet)
                values = (kind, agent.name, last.object, last.goal, last.seed, clip.verdict(), f"{kind}.mp4")
                rows.append(dict(zip(COLUMNS, values, strict=True)))
                break
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomic(out / "failures.csv", text.getvalue())
    return rows


def _played(agent: Any, last: Any, courses: Path, seed: int) -> tuple[Any, str | None]:
    """The episode that ended so, played alone, and the kind of its failure."""
    from tactile_kit.evaluation.failures import kind_of
    from tactile_kit.evaluation.schedule import schedule
    from tactile_kit.evaluation.symmetry import symmetry_of
    from tactile_kit.view.episode import Episode

    plan = schedule(agent.task, last.object, seed=seed, quiet=True)
    number = next((i for i, episode in enumerate(plan.episodes) if episode.seed == last.seed), None)
    if number is None:
        raise ReproduceError(
            f"{courses}: {last.object}, seed {last.seed} is no episode of the evaluation of seed {seed}"
        )
    episode = Episode(agent, plan.task, plan.variants, plan.specs[number])
    try:
        while not episode.done:
            episode.step()
    finally:
        episode.close()
    clip, frame = episode.clip, episode.clip.frames[-1]
    ended = clip.outcome
    assert ended is not None
    end = "fault" if ended.fault else "drop" if ended.drop else "time"
    error = 0.0 if clip.errors is None else float(clip.errors[-1])
    symmetry = symmetry_of(clip.held)
    return clip, kind_of(
        end, ended.theta, error, float(symmetry.error(frame.belief.rotation, frame.truth.rotation))
    )
