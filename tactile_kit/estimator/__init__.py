"""The tactile state estimator: recurrent cell, loss, trainer and the Kalman baseline (paper, section II-D).

Names load on first use, so that reading settings doesn't import torch.
"""

from __future__ import annotations

from tactile_kit.lazy import on_first_use

_HOMES = {
    "CELLS": ".cells",
    "EstimatorCell": ".cell",
    "EstimatorConfig": ".config",
    "EstimatorError": "..errors",
    "EstimatorState": ".state",
    "EstimatorTrainer": ".trainer",
    "KalmanConfig": ".kalman",
    "KalmanFilter": ".kalman",
    "Rest": ".rest",
    "Sequences": ".sequences",
    "estimator_loss": ".loss",
    "cell_of": ".cells",
    "new_cell": ".cells",
    "sequence_loss": ".losses",
}
__all__ = sorted(_HOMES)
__getattr__ = on_first_use(__name__, _HOMES)
