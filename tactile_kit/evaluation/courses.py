"""Courses: how an agent's episodes went, second by second, where rows only say how they ended.

One line an episode and moment: angles to the goal and of the estimate, and what sigma said. Sensitivity to single terms
of the randomisation, errors against time, the speed of turning and kinds of failure are made from such files.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from object_sets.storage import write_atomic
from tactile_kit.errors import EpisodeFileError
from tactile_kit.evaluation.rows import SUCCESS_ANGLE
from tactile_kit.files import read_text

ENDS = ("", "time", "drop", "fault")
MOMENTS = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # s


@dataclass(frozen=True, slots=True)
class Moment:
    """One moment of an episode.

    ``condition``: what it was played under, in words; ``time`` in s; ``theta``, ``believed``, ``error``: true and
    believed angle to the goal and angle of the estimate, rad; ``position``: error of the estimate, m; ``sigma``:
    predicted, rad. An oracle believes the truth: no error, sigma 0. ``mean_error``: rad, of all steps so far. The last
    moment of an episode has its ``end``: time, drop or fault. ``symmetric``: the error up to turns that leave the
    object as it is (``symmetry``), rad; None in files written before it was measured.
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
    symmetric: float | None = None

    @property
    def success(self) -> bool:
        """Whether the episode ended here, at its goal (paper, Sec. II-E)."""
        return self.end == "time" and self.theta < SUCCESS_ANGLE


COLUMNS = tuple(field.name for field in fields(Moment))
_BEFORE = COLUMNS[:-1]
_TEXT, _WHOLE = ("condition", "object", "end"), ("object_id", "goal", "seed")


def write_courses(path: str | os.PathLike, lines: Sequence[Moment]) -> None:
    """Writes a file of courses: the same lines give the same bytes; a half-written file never bears the name."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(COLUMNS)
    for line in lines:
        values = (getattr(line, name) for name in COLUMNS)
        writer.writerow([format(round(v, 6), ".5g") if isinstance(v, float) else v for v in values])
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
    if not rows or tuple(rows[0]) not in (COLUMNS, _BEFORE):
        raise EpisodeFileError(f"{path}, line 1: allowed is the header {','.join(COLUMNS)}")
    lines: list[Moment] = []
    seen: dict[tuple, int] = {}
    for number, cells in enumerate(rows[1:], start=2):
        line = _parsed(rows[0], cells, f"{path}, line {number}")
        first = seen.setdefault((line.condition, line.object_id, line.goal, line.seed, line.time), number)
        if first != number:
            raise EpisodeFileError(
                f"{path}, line {number}: the moment of line {first} again; allowed is each once"
            )
        lines.append(line)
    return lines


def _parsed(header: list[str], cells: list[str], where: str) -> Moment:
    if len(cells) != len(header):
        raise EpisodeFileError(f"{where}: {len(cells)} columns; allowed are exactly {len(header)}")
    values: dict[str, Any] = dict(zip(header, cells, strict=True))
    if not values.get("symmetric", "?"):  # kept from a file written before
        del values["symmetric"]
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
