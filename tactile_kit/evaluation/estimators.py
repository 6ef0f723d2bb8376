"""What tells an agent of the pose in an evaluation: its own estimator, or one that learns nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def _filtered(agent: Any) -> Any:
    from tactile_kit.estimator import KalmanFilter

    return agent.told_by(KalmanFilter())


#: By name, from agent to agent.
ESTIMATORS: dict[str, Callable[[Any], Any]] = {"own": lambda agent: agent, "kalman": _filtered}
