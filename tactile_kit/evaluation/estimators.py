"""What tells an agent of the pose: its own estimator, another agent's cell, or something that learns nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from tactile_kit.errors import EvaluationError


def _filtered(agent: Any) -> Any:
    from tactile_kit.estimator import KalmanFilter

    return agent.told_by(KalmanFilter())


def _resting(agent: Any) -> Any:
    from tactile_kit.estimator import Rest

    return agent.told_by(Rest())


#: By name, from agent to agent.
ESTIMATORS: dict[str, Callable[[Any], Any]] = {
    "own": lambda agent: agent,
    "kalman": _filtered,
    "rest": _resting,
}


def told(agent: Any, by: str) -> Any:
    """The agent told of the pose ``by`` a name of ``ESTIMATORS``, or the cell of the tactile agent in that directory.

    Raises:
        EvaluationError: neither; or an agent without an estimator. A directory that is no agent raises ``AgentError``.
    """
    if by in ESTIMATORS:
        return ESTIMATORS[by](agent)
    if not (Path(by) / "agent.json").is_file():
        allowed = ", ".join(map(repr, ESTIMATORS))
        raise EvaluationError(f"estimator = {by!r}; allowed are {allowed} and directories of tactile agents")
    from tactile_kit.agents.agent import load_agent

    other = load_agent(by)
    if other.estimator is None:
        raise EvaluationError(f"estimator = {by!r}: an {other.kind} has no estimator")
    return agent.told_by(other.estimator)
