"""Worlds, bodies and drawn physics shared by the simulation's tests; prepared files go to a folder of the run."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import object_sets
import randomization
from object_sets import Object
from tactile_kit.hand import kinematics
from tactile_kit.simulation.banks import BulletFinder, find_banks
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.grasps import GraspBank
from tactile_kit.simulation.world import Grasp, World

sys.path.insert(0, str(Path(__file__).parent))  # this folder's helper modules

AWAY = np.array([0.0, 0.0, 2.0])  # where the object troubles nobody


@pytest.fixture(scope="session")
def things() -> dict[str, Object]:
    return {thing.name: thing for thing in object_sets.load("all")}


@pytest.fixture(scope="session")
def bodies(things: dict[str, Object], own_cache: None) -> list[Body]:
    """Cube and L."""
    return [Body(things["cube"]), Body(things["l_shape"])]


@pytest.fixture(scope="session")
def bank(things: dict[str, Object], own_cache: None) -> GraspBank:
    """Two grasps each of cube and L."""
    return find_banks(BulletFinder(2, SimulationConfig()), [[things["cube"]], [things["l_shape"]]])[1]


@pytest.fixture(scope="session")
def physics() -> dict[str, Any]:
    return randomization.preset("none").draw("episode", 0)


@pytest.fixture
def make_world() -> Iterator[Callable[..., World]]:
    made = []

    def make(**settings: Any) -> World:
        made.append(World(SimulationConfig(**settings)))
        return made[-1]

    yield make
    for world in made:
        world.close()


@pytest.fixture
def free_hand(make_world, bodies, physics) -> Callable[..., World]:
    """A hand at the mean grasp (or at ``joints``) with the object far off; keywords change the physics.

    Without ``touch`` the fingers pass through each other.
    """

    def make(
        rate: int = 60, joints: np.ndarray = kinematics.MEAN_GRASP, touch: bool = True, **changes: Any
    ) -> World:
        world = make_world(steps_per_second=rate, solver_iterations=200, solver_residual=0.0)
        world.load(bodies[0], {**physics, **changes})
        world.place(Grasp(kinematics.expand(joints), joints, AWAY, np.eye(3)))
        if not touch:
            for finger in world.hand.fingers:
                for link in range(4):
                    world.bullet.setCollisionFilterGroupMask(finger, link, 0, 0)
        return world

    return make
