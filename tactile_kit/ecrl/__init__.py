"""Estimator-coupled reinforcement learning: the policy acts on the estimate while both are trained (section II-F).

Names load on first use, so that reading settings doesn't import torch or Bullet.
"""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    "Coupling": "coupling",
    "ECRLConfig": "config",
    "Memory": "memory",
    "Schedule": "config",
    "TactileVecEnv": "vec_env",
}
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
