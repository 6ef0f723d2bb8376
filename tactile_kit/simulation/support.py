"""A helping hand for curricula: while gravity is below the earth's, a spring and thick air hold the object.

Both fade in proportion as gravity rises, and are nothing at full gravity. With them a finger may let go before the
others have learned to hold, so that regrasping is found early (docs/training-on-cpu.md).
"""

from __future__ import annotations

from randomization import STANDARD_GRAVITY
from tactile_kit.simulation.config import SimulationConfig


def _share(gravity: float) -> float:
    return max(0.0, 1.0 - gravity / STANDARD_GRAVITY)


def stiffness_of(config: SimulationConfig, gravity: float) -> float:
    """Stiffness (N/m) of the spring to the object's first place under ``gravity`` m/s^2."""
    return config.support * _share(gravity)


def drag_of(config: SimulationConfig, gravity: float) -> float:
    """Rate (1/s) at which the object's speed and spin die down under ``gravity`` m/s^2."""
    return config.drag * _share(gravity)
