"""The search for grasps in the compiled physics: the recipe of simulation/grasps.py, for many tries at once.

For tasks that are played in the compiled physics: what an agent is measured on starts from grasps of Bullet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

import randomization
from object_sets import Object
from tactile_kit.hand import inverse, kinematics
from tactile_kit.shape import MeshTable
from tactile_kit.simulation import grasps as recipe
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.compiled.batch import Batch
from tactile_kit.simulation.config import SimulationConfig, command_share
from tactile_kit.simulation.grasps import Grasp, Tries, draw_tries
from tactile_kit.simulation.world import MAX_JOINT_SPEED

Array = NDArray[Any]
PHYSICS = 2  # counts changes of this file and of the compiled physics that give other grasps
TOGETHER = 16  # tries at once, a multiple of it
# Of the friction, under gravity. These contacts hold tries that slip in Bullet: what holds with less, Bullet holds too.
MARGIN = 0.8
FRICTION = ("tip_friction", "link_friction", "spinning_friction")


@dataclass
class CompiledFinder:
    """``count`` grasps found in the compiled physics under ``config`` (without thick air); see ``banks.Finder``."""

    worth: ClassVar[int] = 12  # a process has torch to import, a bank takes a few tenths of a second
    count: int
    config: SimulationConfig
    seed: int = 0
    spread: float = 0.0
    attempts: int = recipe.ATTEMPTS

    def key(self) -> list[Any]:
        """See ``banks.Finder``."""
        physics = self.config.model_dump(exclude={"engine", "drag"})
        return ["compiled", PHYSICS, self.count, self.seed, self.spread, physics]

    def find(self, thing: Object) -> Sequence[Grasp]:
        """See ``banks.Finder``; the tries are those of ``find_grasps``, in the same order."""
        tries = draw_tries(thing, self.count, self.seed, self.attempts, self.spread)
        bodies, meshes = [Body(thing)], MeshTable.from_meshes([(thing.vertices, thing.faces)])
        found: list[Grasp] = []
        first, share = 0, 0.7  # of the tries that hold; a guess
        while len(found) < self.count and first < len(tries):
            wanted = (self.count - len(found)) / max(share, 0.05)
            last = min(first + TOGETHER * int(np.ceil(wanted / TOGETHER)), len(tries))
            found += try_grasps(self.config, bodies, meshes, tries.part(first, last))
            first, share = last, len(found) / last
        if len(found) < self.count:
            raise recipe.too_few(thing, len(found), self.count, len(tries))
        return found[: self.count]

    def close(self) -> None:
        """See ``banks.Finder``."""


def try_grasps(
    config: SimulationConfig, bodies: Sequence[Body], meshes: MeshTable, tries: Tries
) -> list[Grasp]:
    """Close as many hands as there are ``tries`` around the one of ``bodies``; the grasps that hold, in their order."""
    count = len(tries)
    every = np.arange(count)
    batch = Batch(config, bodies, meshes, count)
    start = recipe.opened(tries.offset)
    batch.place(every, np.zeros(count, np.int64), start, start, np.zeros((count, 3)), tries.rotation)
    weightless = {**randomization.preset("none").draw("episode", 0), "gravity": 0.0}
    batch.set_physics(every, [weightless] * count)
    good = _close(batch, tries)
    heavy = {**weightless, "gravity": randomization.STANDARD_GRAVITY}
    heavy |= {name: MARGIN * weightless[name] for name in FRICTION}
    batch.set_physics(every, [heavy] * count)
    command = _hands(batch.now.filtered)
    batch.now.target[:] = _columns(command)
    for step in range(recipe.HOLDING_STEPS):
        if step == recipe.HOLDING_STEPS // 2:
            before, turned = batch.pose(every)
        batch.step()
        good &= _sound(batch)
    position, rotation = batch.pose(every)
    batch.close()
    held = good & recipe.rests(position, rotation, before, turned)
    joints, command = _hands(batch.now.q), _hands(batch.now.filtered)
    return [
        Grasp(kinematics.expand(joints[e]), command[e], position[e], rotation[e])
        for e in np.flatnonzero(held)
    ]


def _close(batch: Batch, tries: Tries) -> NDArray[np.bool_]:
    """As ``grasps._close`` does; whether a try went well, ``(n,)``."""
    now, share = batch.now, command_share(batch.config.filter_time_constant)
    place, quaternion = now.place.copy(), now.quaternion.copy()
    free, good = tries.closing.copy(), np.ones(len(tries), bool)
    for step in range(recipe.CLOSING_STEPS + recipe.SETTLING_STEPS):
        command = _hands(now.filtered)
        commanded, tips = inverse.tips_of_many(command), inverse.tips_of_many(_hands(now.q))
        distance = np.linalg.norm(tips, axis=2, keepdims=True)
        inwards = -tips / distance
        lag = ((commanded - tips) * inwards).sum(axis=2)
        free &= (lag < recipe.FELT) & (distance[..., 0] > recipe.NEAREST) & (step < recipe.CLOSING_STEPS)
        target = command.copy()
        moving = free.any(axis=1)
        aim = inverse.joints_for_many((commanded + recipe.CLOSING * inwards)[moving], command[moving])
        fingers = np.repeat(free[moving], kinematics.DRIVEN, axis=1)
        target[moving] += np.where(fingers, (aim - command[moving]) / share, 0.0)
        now.target[:] = _columns(np.clip(target, kinematics.JOINT_LOWER, kinematics.JOINT_UPPER))
        batch.step()
        good &= _sound(batch)
        if step == 0:
            good &= now.deepest > -recipe.MAX_INSIDE  # the open hand was in the object already
        now.place[:], now.quaternion[:], now.velocity[:] = place, quaternion, 0.0
    return good


def _sound(batch: Batch) -> NDArray[np.bool_]:
    """Whether a hand's state means anything, ``(n,)``; the limit is that of Bullet's world."""
    now = batch.now
    fastest = np.abs(now.dq).max(axis=(0, 1))
    return np.isfinite(now.place).all(axis=0) & (fastest <= MAX_JOINT_SPEED)


def _hands(columns: Array) -> Array:
    """A copy of ``(4, 3, n)`` as ``(n, 12) float64``."""
    return np.array(columns.reshape(kinematics.JOINTS, -1).T, np.float64, order="C")


def _columns(hands: Array) -> Array:
    return hands.T.reshape(kinematics.FINGERS, kinematics.DRIVEN, -1)
