"""Training runs: settings, run directories, checkpoints, exported agents.

Names load on first use, so that reading settings doesn't import torch.
"""

from __future__ import annotations

from tactile_kit.lazy import on_first_use

_HOMES = {
    "CheckpointError": "..errors",
    "ConfigError": "..errors",
    "LockedError": "..errors",
    "RunConfig": ".config",
    "RunError": "..errors",
    "finished": ".training",
    "presets": ".config",
    "read_metrics": ".metrics",
    "train": ".training",
}
__all__ = sorted(_HOMES)
__getattr__ = on_first_use(__name__, _HOMES)
