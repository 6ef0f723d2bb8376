"""The kinds of cell by name; a new one is one file and one line here."""

from __future__ import annotations

from typing import Any

import torch

from randomization import derive
from tactile_kit.errors import EstimatorError
from tactile_kit.estimator.cell import EstimatorCell
from tactile_kit.estimator.config import EstimatorConfig
from tactile_kit.estimator.finger_cell import FingerCell
from tactile_kit.estimator.paper_cell import PaperCell

CELLS: dict[str, type[EstimatorCell]] = {"paper": PaperCell, "fingers": FingerCell}


def cell_of(config: EstimatorConfig, shape: Any) -> EstimatorCell:
    """A cell of the settings' kind, its weights from torch's global generator; ``shape`` as of ``EstimatorCell``.

    Raises EstimatorError for a kind that is not there.
    """
    if config.cell not in CELLS:
        raise EstimatorError(f"estimator.cell {config.cell!r} unknown, allowed: {', '.join(CELLS)}")
    return CELLS[config.cell](config, shape)  # type: ignore[call-arg]


def new_cell(config: EstimatorConfig, shape: Any, seed: int) -> EstimatorCell:
    """A cell with fresh weights from a stream of ``seed``; torch's global generator is left as it was."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(derive(seed, "estimator", "weights"))
        return cell_of(config, shape)
