"""Can the hand hold it? The grasp check behind ``object-sets sample --graspable``."""

from __future__ import annotations

from object_sets import Object
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.grasps import GraspError, find_grasps
from tactile_kit.simulation.world import World

GRASPS = 4
ATTEMPTS = 15  # a grasp; a cube needs one or two


def holds(thing: Object, seed: int = 0) -> bool:
    """Whether ``GRASPS`` grasps of ``thing`` are found in ``GRASPS * ATTEMPTS`` random orientations.

    Grasps are those that episodes start from: the object in the air, four fingers closed around it, full gravity
    (section II-E of the paper). The answer depends on the object and ``seed`` only.
    """
    world = World(SimulationConfig())
    try:
        find_grasps(world, thing, GRASPS, seed, ATTEMPTS)
    except GraspError:
        return False
    finally:
        world.close()
    return True
