"""Courses: how an agent's episodes went, second by second, where rows only say how they ended.

One line an episode and moment: angles to the goal and of the estimate, and what sigma said. Sensitivity to single terms
of the randomisation, errors against time and the speed of turning are made from such files.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from object_sets.storage import write_atomic
from randomization import derive
from tactile_kit.errors import EpisodeFileError
from tactile_kit.evaluation.schedule import HORIZON, schedule
from tactile_kit.files import read_text
from tactile_kit.rotations import geodesic
from tactile_kit.simulation.config import CONTROL_RATE

ENDS = ("", "time", "drop", "fault")
MOMENTS = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # s
ENVIRONMENTS = 52  # at a time


@dataclass(frozen=True, slots=True)
class Moment:
    """One moment of an episode.

    ``condition``: what it was played under, in words; ``time`` in s; ``theta``, ``believed``, ``error``: true and
    believed angle to the goal and angle of the estimate, rad; ``position``: error of the estimate, m; ``sigma``:
    predicted, rad. An oracle believes the truth: no error, sigma 0. ``mean_error``: rad, of all steps so far. The last
    moment of an episode has its ``end``: time, drop or fault.
    """

    condition: str
    object_id: int
    object: str
    goal: int
    seed: int
    time: float
    theta: float
    believed: float
    error: float
    mean_error: float
    position: float
    sigma: float
    end: str

    @property
    def success(self) -> bool:
        """Whether the episode ended here, at its goal (paper, Sec. II-E)."""
        return self.end == "time" and self.theta < 0.4


COLUMNS = tuple(field.name for field in fields(Moment))
_TEXT, _WHOLE = ("condition", "object", "end"), ("object_id", "goal", "seed")


def play(
    agent: Any,
    condition: str,
    moments: Sequence[float] = MOMENTS,
    progress: Callable[[int, int], None] | None = None,
    **settings: Any,
) -> list[Moment]:
    """Plays an evaluation and returns its moments, episode by episode; drops and ends always have one.

    Args:
        agent: what ``tactile_kit.load_agent`` returns.
        condition: written into every line.
        moments: s, at which lines are taken.
        progress: called with (episodes done, episodes in all).
        settings: of :func:`tactile_kit.evaluation.schedule.schedule`: objects, goals, seed, randomization, world.
    """
    plan = schedule(agent.task, **settings)
    found: list[Moment] = []
    for first in range(0, len(plan.specs), ENVIRONMENTS):
        specs = plan.specs[first : first + ENVIRONMENTS]
        env = agent.make_env(
            plan.task,
            len(specs),
            settings.get("num_workers", 1),
            derive(0, "evaluation"),
            specs,
            plan.variants,
        )
        try:
            lines = _lines(agent, env, moments)
        finally:
            env.close()
        for number, course in enumerate(lines, start=first):
            episode = plan.episodes[number]
            thing = plan.variants.objects[plan.cases[episode.case].held]
            found += [
                Moment(condition, thing.id, thing.name, episode.goal, episode.seed, **line) for line in course
            ]
        if progress is not None:
            progress(first + len(specs), len(plan.specs))
    return found


def _lines(agent: Any, env: Any, moments: Sequence[float]) -> list[list[dict[str, Any]]]:
    """One episode an environment: its lines without what names it."""
    steps = {round(moment * CONTROL_RATE) for moment in moments}
    count = env.num_envs
    lines: list[list[dict[str, Any]]] = [[] for _ in range(count)]
    playing, total = np.ones(count, bool), np.zeros(count)
    observation = env.reset()
    for step in range(1, HORIZON + 1):
        observation, _, done, infos = env.step(agent.act(observation))
        last = env.transition
        told = last if agent.estimator is None else env.estimated
        values = {
            "theta": geodesic(last.R, last.goal),
            "believed": geodesic(told.R, last.goal),
            "error": geodesic(told.R, last.R),
            "position": np.linalg.norm(told.x - last.x, axis=1),
            "sigma": np.zeros(count) if getattr(told, "sigma", None) is None else told.sigma[:, 1],
        }
        total += values["error"]
        for e in np.flatnonzero(playing & (done | (step in steps))).tolist():
            end = ""
            if done[e]:
                end = "fault" if infos[e]["fault"] else "drop" if infos[e]["drop"] else "time"
            line = {name: float(value[e]) for name, value in values.items()}
            lines[e].append(
                {"time": step / CONTROL_RATE, "mean_error": float(total[e] / step), "end": end, **line}
            )
        playing &= ~done
    return lines


def write_courses(path: str | os.PathLike, lines: Sequence[Moment]) -> None:
    """Writes a file of courses: the same lines give the same bytes; a half-written file never bears the name."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(COLUMNS)
    for line in lines:
        values = (getattr(line, name) for name in COLUMNS)
        writer.writerow([format(v, ".5g") if isinstance(v, float) else v for v in values])
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    write_atomic(Path(path), buffer.getvalue().encode())


def read_courses(path: str | os.PathLike) -> list[Moment]:
    """The lines of a file, in order.

    Raises ``EpisodeFileError`` naming file, line, column, value and what is allowed.
    """
    path = Path(path)
    text = read_text(path, EpisodeFileError, "file of courses")
    try:
        rows = list(csv.reader(io.StringIO(text, newline="")))
    except csv.Error as problem:
        raise EpisodeFileError(f"{path}: no CSV ({problem})") from None
    if not rows or tuple(rows[0]) != COLUMNS:
        raise EpisodeFileError(f"{path}, line 1: allowed is the header {','.join(COLUMNS)}")
    lines: list[Moment] = []
    seen: dict[tuple, int] = {}
    for number, cells in enumerate(rows[1:], start=2):
        line = _parsed(cells, f"{path}, line {number}")
        first = seen.setdefault((line.condition, line.object_id, line.goal, line.seed, line.time), number)
        if first != number:
            raise EpisodeFileError(
                f"{path}, line {number}: the moment of line {first} again; allowed is each once"
            )
        lines.append(line)
    return lines


def _parsed(cells: list[str], where: str) -> Moment:
    if len(cells) != len(COLUMNS):
        raise EpisodeFileError(f"{where}: {len(cells)} columns; allowed are exactly {len(COLUMNS)}")
    values: dict[str, Any] = dict(zip(COLUMNS, cells, strict=True))
    for name, text in values.items():
        if name in _TEXT:
            continue
        try:
            values[name] = int(text) if name in _WHOLE else float(text)
        except ValueError:
            raise EpisodeFileError(f"{where}: {name} = {text!r}; allowed is a number") from None
        if not math.isfinite(values[name]):
            raise EpisodeFileError(f"{where}: {name} = {text!r}; allowed are finite numbers")
    if values["end"] not in ENDS:
        raise EpisodeFileError(f"{where}: end = {values['end']!r}; allowed are {', '.join(map(repr, ENDS))}")
    return Moment(**values)
