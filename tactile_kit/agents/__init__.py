"""Policy networks, the learner: PPO as in the paper, and agents loaded from disk.

Names load on first use, so that reading settings doesn't import torch.
"""

from __future__ import annotations

from tactile_kit.lazy import on_first_use

_HOMES = {
    "Agent": ".agent",
    "AgentError": "..errors",
    "InputLayout": ".networks",
    "Manifest": ".manifest",
    "NetworkConfig": ".config",
    "PPO": ".ppo",
    "PPOConfig": ".config",
    "load_agent": ".agent",
    "warm_start": ".warm_start",
}
__all__ = sorted(_HOMES)
__getattr__ = on_first_use(__name__, _HOMES)
