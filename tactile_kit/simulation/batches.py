"""Batches of episodes, and what finds their grasps, by engine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from tactile_kit.errors import EngineError, nearest
from tactile_kit.shape import MeshTable
from tactile_kit.simulation.banks import BulletFinder, Finder
from tactile_kit.simulation.config import MEASUREMENT_RATE, SimulationConfig
from tactile_kit.simulation.engines import engine_of
from tactile_kit.simulation.worker import Blueprint

KINDS = ("processes", "ray")  # what holds the simulators


def _processes(blueprint: Blueprint, meshes: MeshTable, environments: int, workers: int, kind: str) -> Any:
    if kind == "ray":
        from tactile_kit.simulation.ray_workers import RaySimulation

        return RaySimulation(blueprint, environments, workers)
    from tactile_kit.simulation.vector import VectorSimulation

    return VectorSimulation(blueprint, environments, workers)


def _threads(blueprint: Blueprint, meshes: MeshTable, environments: int, workers: int, kind: str) -> Any:
    if kind == "ray":  # a step of it costs less than sending it, beside a learner that costs more than both
        raise EngineError("workers = 'ray': allowed with an engine of worker processes, such as bullet")
    from tactile_kit.simulation.compiled import CompiledSimulation

    return CompiledSimulation(blueprint, meshes, environments, workers)


def _bullet_finder(count: int, config: SimulationConfig, spread: float) -> Finder:
    return BulletFinder(count, _coarse(config), spread=spread)


def _compiled_finder(count: int, config: SimulationConfig, spread: float) -> Finder:
    from tactile_kit.simulation.compiled.grasping import CompiledFinder

    return CompiledFinder(count, _coarse(config), spread=spread)


def _mujoco_finder(count: int, config: SimulationConfig, spread: float) -> Finder:
    from tactile_kit.simulation.mujoco.grasping import MujocoFinder

    return MujocoFinder(count, config, spread=spread)


def _coarse(config: SimulationConfig) -> SimulationConfig:
    """Grasps are starting states, and every episode lets them settle: Bullet's coarsest step does."""
    return config.plain(MEASUREMENT_RATE)


class _Makers(NamedTuple):
    simulation: Callable[[Blueprint, MeshTable, int, int, str], Any]
    finder: Callable[[int, SimulationConfig, float], Finder]


MAKERS = {
    "bullet": _Makers(_processes, _bullet_finder),
    "compiled": _Makers(_threads, _compiled_finder),
    "mujoco": _Makers(_processes, _mujoco_finder),
}


def simulation_of(
    config: SimulationConfig, blueprint: Blueprint, meshes: MeshTable, environments: int, workers: int,
    kind: str = "processes",
) -> Any:  # fmt: skip
    """``environments`` episodes at a time over ``workers`` processes or threads, or Ray actors where ``kind`` is ray.

    Raises EngineError: something is not installed, or the engine has no workers that Ray could take.
    """
    engine_of(config.engine).require()
    if kind not in KINDS:
        raise EngineError(f"workers = {kind!r}: unknown{nearest(kind, KINDS)}")
    return MAKERS[config.engine].simulation(blueprint, meshes, environments, workers, kind)


def finder_of(config: SimulationConfig, count: int, spread: float) -> Finder:
    """What looks for ``count`` grasps that stray by ``spread`` (rad). Raises EngineError: not installed."""
    engine_of(config.engine).require()
    return MAKERS[config.engine].finder(count, config, spread)
