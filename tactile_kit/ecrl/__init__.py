"""Estimator-coupled reinforcement learning: the policy acts on the estimate while both are trained (section II-F).

Names load on first use, so that reading settings doesn't import torch or Bullet.
"""

from __future__ import annotations

from tactile_kit.lazy import on_first_use

_HOMES = {
    "Coupling": ".coupling",
    "ECRLConfig": ".config",
    "Memory": ".memory",
    "Schedule": ".config",
    "TactileVecEnv": ".vec_env",
}
__all__ = sorted(_HOMES)
__getattr__ = on_first_use(__name__, _HOMES)
