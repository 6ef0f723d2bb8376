"""A Bullet client whose functions know their connection."""

from __future__ import annotations

import functools
from typing import Any

from tactile_kit.simulation.quiet_bullet import pybullet


class Client:
    """``pybullet`` with the client's id filled in; each function is bound once, at its first use."""

    def __init__(self) -> None:
        self.id = pybullet.connect(pybullet.DIRECT)
        if self.id < 0:
            raise RuntimeError("Bullet accepts no further client in this process: use more worker processes")

    def __getattr__(self, name: str) -> Any:
        value = getattr(pybullet, name)
        if callable(value):
            value = functools.partial(value, physicsClientId=self.id)
        self.__dict__[name] = value
        return value

    def disconnect(self) -> None:
        """Close the connection; a second call does nothing."""
        if self.id >= 0:
            pybullet.disconnect(self.id)
            self.id = -1
