"""Policy networks, the learner: PPO as in the paper, and agents loaded from disk.

Names load on first use, so that reading settings doesn't import torch.
"""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    "Agent": "agent",
    "AgentError": "errors",
    "InputLayout": "networks",
    "Manifest": "manifest",
    "NetworkConfig": "config",
    "PPO": "ppo",
    "PPOConfig": "config",
    "load_agent": "agent",
    "warm_start": "warm_start",
}
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
