"""The physics engines by name: what each can do, and how its parts are made. Nothing else asks for a name."""

from __future__ import annotations

import difflib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactile_kit.shape import MeshTable
    from tactile_kit.simulation.banks import Finder
    from tactile_kit.simulation.config import SimulationConfig
    from tactile_kit.simulation.worker import Blueprint


class EngineError(ValueError):
    """A physics engine that is unknown, not installed, or can't do what is asked of it."""


@dataclass(frozen=True)
class Engine:
    """One physics engine.

    Attributes:
        world: makes the world of a single episode from its settings, ``visible`` in pictures or not; None where the
            engine plays batches only. Agents are evaluated in engines that have worlds.
        vector: makes ``environments`` episodes at a time over ``workers`` processes or threads.
        finder: makes what looks for ``count`` grasps under the settings, with their ``spread``.
        evaluation_rate: physics steps a second of an evaluation, unless another is asked for.
        air: whether it has thick air.
        package, extra: what has to be installed beside the project, and what installs it; empty: nothing.
    """

    world: Callable[[SimulationConfig, bool], Any] | None
    vector: Callable[[Blueprint, MeshTable, int, int], Any]
    finder: Callable[[int, SimulationConfig, float], Finder]
    evaluation_rate: int = 0
    air: bool = False
    package: str = ""
    extra: str = ""

    @property
    def installed(self) -> bool:
        """Whether the engine can be used here."""
        return not self.package or importlib.util.find_spec(self.package) is not None

    def require(self) -> None:
        """Raises EngineError where the engine is not installed."""
        if not self.installed:
            raise EngineError(
                f"the package {self.package} is not installed; pip install 'tactile-kit[{self.extra}]' brings it"
            )


def _bullet_world(config: SimulationConfig, visible: bool) -> Any:
    from tactile_kit.simulation.world import World

    return World(config, visible)


def _mujoco_world(config: SimulationConfig, visible: bool) -> Any:
    from tactile_kit.simulation.mujoco import MujocoWorld

    return MujocoWorld(config, visible)


def _processes(blueprint: Blueprint, meshes: MeshTable, environments: int, workers: int) -> Any:
    from tactile_kit.simulation.vector import VectorSimulation

    return VectorSimulation(blueprint, environments, workers)


def _threads(blueprint: Blueprint, meshes: MeshTable, environments: int, workers: int) -> Any:
    from tactile_kit.simulation.compiled import CompiledSimulation

    return CompiledSimulation(blueprint, meshes, environments, workers)


def _bullet_finder(count: int, config: SimulationConfig, spread: float) -> Finder:
    from tactile_kit.simulation.banks import BulletFinder

    return BulletFinder(count, _coarse(config), spread=spread)


def _compiled_finder(count: int, config: SimulationConfig, spread: float) -> Finder:
    from tactile_kit.simulation.compiled.grasping import CompiledFinder

    return CompiledFinder(count, _coarse(config), spread=spread)


def _mujoco_finder(count: int, config: SimulationConfig, spread: float) -> Finder:
    from tactile_kit.simulation.mujoco import MujocoFinder

    return MujocoFinder(count, config, spread=spread)


def _coarse(config: SimulationConfig) -> SimulationConfig:
    """Grasps are starting states, and every episode lets them settle: Bullet's coarsest step does."""
    from tactile_kit.simulation.config import MEASUREMENT_RATE

    return config.plain(MEASUREMENT_RATE)


ENGINES: dict[str, Engine] = {
    # The finest step that a whole `make reproduce` affords; docs/physics.md has finer ones beside it.
    "bullet": Engine(_bullet_world, _processes, _bullet_finder, evaluation_rate=120),
    "compiled": Engine(None, _threads, _compiled_finder, air=True),
    # The robot's controller runs at 1 kHz; this is the next multiple of the measurement rate.
    "mujoco": Engine(
        _mujoco_world, _processes, _mujoco_finder, evaluation_rate=1020, package="mujoco", extra="transfer"
    ),
}
WORLDS = tuple(name for name, engine in ENGINES.items() if engine.world is not None)


def engine_of(name: str) -> Engine:
    """The engine of that name. Raises EngineError with the nearest one that there is."""
    if name not in ENGINES:
        near = difflib.get_close_matches(name, ENGINES, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise EngineError(f"engine = {name!r}: allowed are {', '.join(map(repr, ENGINES))}{hint}")
    return ENGINES[name]


def world_of(config: SimulationConfig, visible: bool = False) -> Any:
    """The world of a single episode. Raises EngineError where the engine has none or is not installed."""
    make = engine_of(config.engine).world
    if make is None:
        raise EngineError(
            f"simulation.engine = {config.engine!r}: allowed are {', '.join(map(repr, WORLDS))} for a single "
            "environment, pictures and planning; the compiled physics plays batches (tactile_kit.make_vec)"
        )
    return make(config, visible)
