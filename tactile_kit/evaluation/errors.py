"""Errors of evaluation. All are ``ValueError``; the message names the file, the value and what is allowed."""

from __future__ import annotations


class EvaluationError(ValueError):
    """An evaluation that can't be run as asked: unknown objects or goals, sizes out of range, an agent that misfits."""


class EpisodeFileError(EvaluationError):
    """An episode file that is malformed or holds a value out of range."""
