"""Grasps in MuJoCo, by the heuristic that finds them in Bullet (simulation/grasps.py)."""

from __future__ import annotations

from typing import Any, ClassVar

from object_sets import Object
from tactile_kit.hand.mjcf import hand_mjcf
from tactile_kit.simulation.banks import BulletFinder
from tactile_kit.simulation.grasps import Grasp, find_grasps
from tactile_kit.simulation.mujoco.scene import CONTACT_TIME, FRICTION_RATIO
from tactile_kit.simulation.mujoco.world import MujocoWorld

RECIPE = 1  # counts changes of this folder that give other grasps


class MujocoFinder(BulletFinder):
    """``count`` grasps found in MuJoCo under ``config``; ``spread`` (rad) as in ``find_grasps``."""

    worth: ClassVar[int] = 1
    world: Any = None

    def key(self) -> list[Any]:
        """See :class:`tactile_kit.simulation.banks.Finder`."""
        hand = hand_mjcf(self.config.filter_time_constant)
        return ["mujoco", RECIPE, CONTACT_TIME, FRICTION_RATIO, hand, *super().key()]

    def find(self, thing: Object) -> list[Grasp]:
        """See :class:`tactile_kit.simulation.banks.Finder`."""
        self.world = self.world or MujocoWorld(self.config)
        return find_grasps(self.world, thing, self.count, self.seed, spread=self.spread)
