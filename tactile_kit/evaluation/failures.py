"""How episodes fail: every failure is of exactly one kind, told from its last moment.

- ``drop``: the object fell, or the physics failed.
- ``lost``: held until the end, but the estimate is 0.4 rad or more off, and from every pose that looks the same too.
- ``symmetry``: held, the estimate 0.4 rad or more off, but within 0.4 rad of a pose that looks like the true one.
- ``stall``: held, the estimate within 0.4 rad of the truth, and yet not at the goal when time was up.

An agent that is told the truth drops or stalls, nothing else. A wrong guess falls within 0.4 rad of some turn of a cube
by chance in 8 of 100 cases, of an object with two turns in 0.7.
"""

from __future__ import annotations

from tactile_kit.errors import EvaluationError
from tactile_kit.evaluation.courses import Moment
from tactile_kit.evaluation.rows import SUCCESS_ANGLE

#: By name, in words.
KINDS = {
    "drop": "dropped",
    "lost": "lost estimate",
    "symmetry": "wrong symmetry",
    "stall": "stalled",
}


def kind_of(end: str, theta: float, error: float, symmetric: float | None) -> str | None:
    """The kind of an episode's failure, None of a success.

    Args:
        end: how it ended: time, drop or fault. theta, error, symmetric: at its end, rad, as of ``courses.Moment``.

    Raises:
        EvaluationError: the episode has not ended, or nobody measured the error up to symmetries.
    """
    if not end:
        raise EvaluationError("end = ''; allowed are the ends of episodes that are over: time, drop, fault")
    if end != "time":
        return "drop"
    if theta < SUCCESS_ANGLE:
        return None
    if error < SUCCESS_ANGLE:
        return "stall"
    if symmetric is None:
        raise EvaluationError("symmetric = None; a kind of failure needs the error up to symmetries")
    return "symmetry" if symmetric < SUCCESS_ANGLE else "lost"


def kind_of_moment(last: Moment) -> str | None:
    """:func:`kind_of` the last moment of a course."""
    return kind_of(last.end, last.theta, last.error, last.symmetric)
