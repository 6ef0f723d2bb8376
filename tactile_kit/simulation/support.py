"""A helping hand for curricula: while gravity is below the earth's, a spring and calm air hold the object's place.

Both fade in proportion as gravity rises, and are nothing at full gravity. With them a finger may let go before the
others have learned to hold, so that regrasping is found early (docs/training-on-cpu.md).
"""

from __future__ import annotations

from randomization import STANDARD_GRAVITY

CALM = 20.0  # 1/s by which supported motion dies down without gravity


def _share(gravity: float) -> float:
    return max(0.0, 1.0 - gravity / STANDARD_GRAVITY)


def stiffness_of(support: float, gravity: float) -> float:
    """Stiffness (N/m) of the spring to the object's first place under ``gravity`` m/s^2."""
    return support * _share(gravity)


def calm_of(support: float, gravity: float) -> float:
    """Rate (1/s) at which the object's speed and spin die down under ``gravity`` m/s^2."""
    return CALM * _share(gravity) if support else 0.0
