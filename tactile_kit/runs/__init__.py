"""Training runs: settings, run directories, checkpoints, exported agents.

Names load on first use, so that reading settings doesn't import torch.
"""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    "CheckpointError": "errors",
    "ConfigError": "errors",
    "LockedError": "errors",
    "RunConfig": "config",
    "RunError": "errors",
    "finished": "training",
    "presets": "config",
    "read_metrics": "metrics",
    "train": "training",
}
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
