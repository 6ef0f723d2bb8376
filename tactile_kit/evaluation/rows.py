"""Episode files: one row an episode, CSV with a header, written atomically and checked on the way in and out.

Every number in a table or figure is computed from such files and from nothing else.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

from tactile_kit.errors import EpisodeFileError
from tactile_kit.files import read_text

SUCCESS_ANGLE = 0.4  # rad; paper, Sec. II-E: a success if theta_T < 0.4 after T = 10 s


@dataclass(frozen=True, slots=True)
class EpisodeRow:
    """One evaluated episode. Angles in rad, extents in m.

    ``given_*`` is the mesh the agent was conditioned on; it is the manipulated object itself unless the evaluation asks
    for another (paper, Figs. 8 and 9). ``size`` counts the prepared sizes of an object (0 where the size is nominal).
    ``goal`` is the index in ``rotations.octahedral()``, or -1 for a goal drawn on SO(3). ``theta`` is the angle to the
    goal at the end (of a dropped object: at the moment of the drop), ``theta_min`` the smallest on the way. Both are
    None only where the simulation failed (``fault`` says how); such an episode counts as a failure. ``world`` is the
    engine it was played in (``tactile_kit.simulation.engines``).
    """

    agent: str
    kind: str  # oracle | tactile | planner
    encoding: str
    training_seed: int
    object_id: int
    object: str
    size: int
    extent_x: float
    extent_y: float
    extent_z: float
    given_id: int
    given: str
    given_extent_x: float
    given_extent_y: float
    given_extent_z: float
    goal: int
    episode: int
    seed: int
    theta: float | None
    theta_min: float | None
    success: bool
    drop: bool
    fault: str
    steps: int
    world: str = "bullet"

    @property
    def furthest_extent(self) -> float:
        """The extent (m) furthest away from the median 6.75 cm; the x-axis of the paper's Fig. 8."""
        return max((self.extent_x, self.extent_y, self.extent_z), key=lambda extent: abs(extent - 0.0675))


COLUMNS: tuple[str, ...] = tuple(field.name for field in fields(EpisodeRow))
_BEFORE = COLUMNS[:-1]  # of files written when Bullet was the only world

# what names an episode; the rest is how it went
_NAMES = (
    "agent", "object_id", "object", "size", "given_id", "given", "goal", "episode", "seed", "world",
)  # fmt: skip

_PI = math.pi + 1e-4  # float32 rounding of an angle of exactly pi


class _Column(NamedTuple):
    """How a column is read (``ValueError`` or ``KeyError`` where it can't be), and in words what it may hold."""

    parse: Callable[[str], Any]
    allowed: str


def _number(lowest: float, highest: float, optional: bool = False) -> _Column:
    def parse(text: str) -> float | None:
        if optional and text == "":
            return None
        value = float(text)
        if not lowest <= value <= highest:  # also false for NaN
            raise ValueError
        return value

    return _Column(parse, f"a number in [{lowest:g}, {highest:g}]" + (" or empty" if optional else ""))


def _integer(lowest: int, highest: int | None = None) -> _Column:
    def parse(text: str) -> int:
        value = int(text)
        if value < lowest or (highest is not None and value > highest):
            raise ValueError
        return value

    return _Column(parse, f"an integer >= {lowest}" + ("" if highest is None else f" and <= {highest}"))


def _line(empty: bool = False) -> _Column:
    def parse(text: str) -> str:
        if "\n" in text or not (text or empty):
            raise ValueError
        return text

    return _Column(parse, "a line of text or empty" if empty else "a non-empty line of text")


_FLAG = _Column({"0": False, "1": True}.__getitem__, "0 or 1")
_KIND = _Column(
    {kind: kind for kind in ("oracle", "tactile", "planner")}.__getitem__, "oracle, tactile or planner"
)
_EXTENT = _number(1e-3, 0.5)
_COLUMNS: dict[str, _Column] = {
    "agent": _line(),
    "kind": _KIND,
    "encoding": _line(),
    "training_seed": _integer(0),
    "object_id": _integer(0),
    "object": _line(),
    "size": _integer(0),
    "extent_x": _EXTENT,
    "extent_y": _EXTENT,
    "extent_z": _EXTENT,
    "given_id": _integer(0),
    "given": _line(),
    "given_extent_x": _EXTENT,
    "given_extent_y": _EXTENT,
    "given_extent_z": _EXTENT,
    "goal": _integer(-1, 23),
    "episode": _integer(0),
    "seed": _integer(0, (1 << 63) - 1),
    "theta": _number(0.0, _PI, optional=True),
    "theta_min": _number(0.0, _PI, optional=True),
    "success": _FLAG,
    "drop": _FLAG,
    "fault": _line(empty=True),
    "steps": _integer(0),
    "world": _line(),
}


def allowed() -> dict[str, str]:
    """What each column may hold, in words."""
    return {name: _COLUMNS[name].allowed for name in COLUMNS}


def _format(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "1" if value else "0"
    if isinstance(value, float):
        return format(value, ".7g")  # single precision; the simulator gives no more
    return str(value)


def _parse(cells: list[str], where: str, columns: tuple[str, ...] = COLUMNS) -> EpisodeRow:
    if len(cells) != len(columns):
        raise EpisodeFileError(f"{where}: {len(cells)} columns; allowed are exactly {len(columns)}")
    values: dict[str, Any] = {}
    for name, text in zip(columns, cells, strict=True):
        column = _COLUMNS[name]
        try:
            values[name] = column.parse(text)
        except (ValueError, KeyError):
            raise EpisodeFileError(f"{where}: {name} = {text!r}; allowed is {column.allowed}") from None
    row = EpisodeRow(**values)
    if (row.theta is None or row.theta_min is None) and not row.fault:
        raise EpisodeFileError(f"{where}: theta or theta_min is empty; allowed only where fault says why")
    if row.success and (
        row.drop or row.fault or (row.theta or 0.0) > SUCCESS_ANGLE + 1e-6
    ):  # rounded in the file
        raise EpisodeFileError(
            f"{where}: success = 1 with drop = {row.drop:d}, fault = {row.fault!r}, theta = {row.theta};"
            f" allowed only without drop or fault and with theta < {SUCCESS_ANGLE} rad"
        )
    return row


def _told_once(row: EpisodeRow, seen: dict[Hashable, str], where: str) -> None:
    """Raises EpisodeFileError for an episode that is there already: counted twice it would narrow every interval."""
    episode = tuple(getattr(row, name) for name in _NAMES)
    first = seen.setdefault(episode, where)
    if first != where:
        name = f"{row.object}, size {row.size}, goal {row.goal}, episode {row.episode}, seed {row.seed}"
        line = first.rpartition(", ")[2]
        raise EpisodeFileError(f"{where}: the episode of {line} again ({name}); allowed is each once")


def write_rows(path: str | os.PathLike, rows: Iterable[EpisodeRow]) -> Path:
    """Writes an episode file. The same rows give the same bytes; a half-written file never bears the name.

    Raises ``EpisodeFileError`` for a row that ``read_rows`` would refuse, such as an episode that comes twice.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    scratch = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with scratch.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(COLUMNS)
            seen: dict[Hashable, str] = {}
            for number, row in enumerate(rows, start=2):
                cells = [_format(getattr(row, name)) for name in COLUMNS]
                where = f"{path}, line {number}"
                _told_once(_parse(cells, where), seen, where)
                writer.writerow(cells)
        os.replace(scratch, path)
    finally:
        scratch.unlink(missing_ok=True)
    return path


def read_rows(path: str | os.PathLike) -> list[EpisodeRow]:
    """The rows of an episode file, in order. A file without the column ``world`` holds episodes of Bullet.

    Raises ``EpisodeFileError`` naming file, line, column, value and what is allowed; a file without episodes, or with
    one twice, is an error too.
    """
    path = Path(path)
    reader = csv.reader(io.StringIO(read_text(path, EpisodeFileError, "episode file"), newline=""))
    rows: list[EpisodeRow] = []
    seen: dict[Hashable, str] = {}
    try:
        header = tuple(next(reader, ()))
        if header not in (COLUMNS, _BEFORE):
            raise EpisodeFileError(
                f"{path}, line 1: {list(header) or None}; allowed is the header {','.join(COLUMNS)}"
            )
        for cells in reader:
            where = f"{path}, line {reader.line_num}"
            rows.append(_parse(cells, where, header))
            _told_once(rows[-1], seen, where)
    except csv.Error as problem:
        raise EpisodeFileError(f"{path}, line {reader.line_num}: no CSV ({problem})") from None
    if not rows:
        raise EpisodeFileError(f"{path}: no episodes; at least one is needed")
    return rows
