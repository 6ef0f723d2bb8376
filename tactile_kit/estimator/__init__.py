"""The tactile state estimator: recurrent cell, loss, trainer and the Kalman baseline (paper, section II-D).

Names load on first use, so that reading settings doesn't import torch.
"""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    "CELLS": "cells",
    "EstimatorCell": "cell",
    "EstimatorConfig": "config",
    "EstimatorError": "errors",
    "EstimatorState": "state",
    "EstimatorTrainer": "trainer",
    "KalmanConfig": "kalman",
    "KalmanFilter": "kalman",
    "Rest": "rest",
    "Sequences": "sequences",
    "estimator_loss": "loss",
    "cell_of": "cells",
    "new_cell": "cells",
    "sequence_loss": "losses",
}
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
