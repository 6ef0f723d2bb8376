"""Worlds of a single episode, by engine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tactile_kit.errors import EngineError
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.engines import WORLDS, engine_of


def _bullet(config: SimulationConfig, visible: bool) -> Any:
    from tactile_kit.simulation.world import World

    return World(config, visible)


def _mujoco(config: SimulationConfig, visible: bool) -> Any:
    from tactile_kit.simulation.mujoco.world import MujocoWorld

    return MujocoWorld(config, visible)


MAKERS: dict[str, Callable[[SimulationConfig, bool], Any]] = {"bullet": _bullet, "mujoco": _mujoco}


def world_of(config: SimulationConfig, visible: bool = False) -> Any:
    """The world of a single episode, ``visible`` in pictures or not. Raises EngineError where the engine has none or
    is not installed."""
    if not engine_of(config.engine).worlds:
        raise EngineError(
            f"simulation.engine = {config.engine!r}: allowed are {', '.join(map(repr, WORLDS))} for a single "
            "environment, pictures and planning; the compiled physics plays batches (tactile_kit.make_vec)"
        )
    return MAKERS[config.engine](config, visible)
