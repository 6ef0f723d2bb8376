"""Evaluation: roll-outs to one row an episode, and what such rows say, with intervals."""

from tactile_kit.errors import EpisodeFileError, EvaluationError
from tactile_kit.evaluation.evaluate import evaluate
from tactile_kit.evaluation.intervals import Interval, difference, stratified_bootstrap, wilson
from tactile_kit.evaluation.rows import COLUMNS, SUCCESS_ANGLE, EpisodeRow, read_rows, write_rows
from tactile_kit.evaluation.summary import (
    Estimate,
    final_angles,
    group,
    mean_final_angle,
    relative_change,
    success_rate,
)

__all__ = [
    "COLUMNS",
    "SUCCESS_ANGLE",
    "EpisodeFileError",
    "EpisodeRow",
    "Estimate",
    "EvaluationError",
    "Interval",
    "difference",
    "evaluate",
    "final_angles",
    "group",
    "mean_final_angle",
    "read_rows",
    "relative_change",
    "stratified_bootstrap",
    "success_rate",
    "wilson",
    "write_rows",
]
