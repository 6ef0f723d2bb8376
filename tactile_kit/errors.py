"""What goes wrong, by kind. All are ``ValueError``: messages name file or setting, the value and what is allowed."""

from __future__ import annotations

from object_sets.errors import nearest

__all__ = [
    "AgentError", "CheckpointError", "ConfigError", "EngineError", "EpisodeFileError", "EstimatorError",
    "EvaluationError", "LockedError", "RunError", "ViewError", "nearest",
]  # fmt: skip


class AgentError(ValueError):
    """An agent directory cannot be used."""


class EngineError(ValueError):
    """A physics engine that is unknown, not installed, or can't do what is asked of it."""


class EstimatorError(ValueError):
    """Input that the estimator can't take: wrong shape, value out of range, or state that doesn't fit the network."""


class EvaluationError(ValueError):
    """An evaluation that can't be run as asked: unknown objects or goals, sizes out of range, an agent that misfits."""


class EpisodeFileError(EvaluationError):
    """An episode file that is malformed or holds a value out of range."""


class RunError(ValueError):
    """A run cannot start or go on."""


class ConfigError(RunError):
    """Settings are unknown, out of range or not those the run was started with."""


class CheckpointError(RunError):
    """No usable checkpoint."""


class LockedError(RunError):
    """Another process works on the run directory."""


class ViewError(ValueError):
    """An episode or a view that can't be made."""
