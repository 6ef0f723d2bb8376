"""Initial states: a randomly turned object, and four fingers closed around it until each feels it.

Every fingertip moves towards the object's centre while the object is held in its place; then it is let go.

The paper (section II-E) spawns a randomly oriented object in the hand and closes the fingers by a heuristic. Grasps are
found once an object and size and kept in a bank, named by the content of everything that they depend on.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import randomization
from object_sets import Object
from object_sets.storage import cache_directory, npz_bytes, write_atomic
from tactile_kit.hand import inverse, kinematics, urdf
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.config import SimulationConfig, command_share
from tactile_kit.simulation.world import Grasp, PhysicsFault, World
from tactile_kit.task.rotations import geodesic, random_rotations

Array = NDArray[np.float64]

OPENING = 0.03  # m a fingertip is away from its place in the mean grasp
CLOSING = 0.005  # m a control step towards the centre
FELT = 0.012  # m by which a tip lags behind its command where it stands against the object
NEAREST = 0.015  # m from the centre: nothing there
CLOSING_STEPS = 20
SETTLING_STEPS = 5
HOLDING_STEPS = 10  # under gravity
MAX_OFFSET = 0.03  # m from the nominal centre
MAX_DRIFT = 0.005  # m during the last half second
MAX_TURN = 0.05  # rad during the last half second
RECIPE = 7  # counts changes of this file and of the physics that give other grasps
ALL = np.ones(kinematics.FINGERS, bool)


class GraspError(RuntimeError):
    """No grasp was found of the object named ``thing``."""

    def __init__(self, message: str, thing: str) -> None:
        super().__init__(message)
        self.thing = thing

    def __reduce__(self) -> tuple:
        return type(self), (self.args[0], self.thing)


def _opened(offset: Array | float) -> Array:
    """Joint angles ``(12,)`` rad with the fingertips away from the object, moved by ``offset``."""
    home = inverse.tips(kinematics.MEAN_GRASP)
    away = home * (1.0 + OPENING / np.linalg.norm(home, axis=1, keepdims=True))
    angles = inverse.joints_for(away, kinematics.MEAN_GRASP) + offset
    return np.clip(angles, kinematics.JOINT_LOWER, kinematics.JOINT_UPPER)


def _close(world: World, closing: NDArray[np.bool_]) -> None:
    """Bring the tips of ``closing (4,)`` to the centre of the object, which is held, until each feels it."""
    place = world.bullet.getBasePositionAndOrientation(world.object)
    target, free = world.command.copy(), closing.copy()
    share = command_share(world.config.filter_time_constant)
    for step in range(CLOSING_STEPS + SETTLING_STEPS):
        command = world.command
        commanded, tips = inverse.tips(command), inverse.tips(world.joints[kinematics.DRIVEN_INDEX])
        distance = np.linalg.norm(tips, axis=1, keepdims=True)
        inwards = -tips / distance
        lag = ((commanded - tips) * inwards).sum(axis=1)
        free &= (lag < FELT) & (distance[:, 0] > NEAREST) & (step < CLOSING_STEPS)
        aim = inverse.joints_for(commanded + CLOSING * inwards, command)
        moving = np.repeat(free, kinematics.DRIVEN)
        target = np.where(moving, command + (aim - command) / share, command)
        world.step(np.clip(target, kinematics.JOINT_LOWER, kinematics.JOINT_UPPER))
        world.bullet.resetBasePositionAndOrientation(world.object, *place)
        world.bullet.resetBaseVelocity(world.object, [0.0] * 3, [0.0] * 3)


def try_grasp(
    world: World,
    body: Body,
    rotation: Array,
    offset: Array | float = 0.0,
    closing: NDArray[np.bool_] = ALL,
) -> Grasp | None:
    """Close the hand around ``body`` turned by ``rotation``; None if the object is not held.

    ``offset`` ``(12,)`` rad is added to the open posture; ``closing`` ``(4,)`` tells the fingers that close.
    """
    weightless = {**randomization.preset("none").draw("episode", 0), "gravity": 0.0}
    world.load(body, weightless)
    start = _opened(offset)
    world.place(Grasp(kinematics.expand(start), start, np.zeros(3), rotation))
    world.bullet.performCollisionDetection()
    if any(contact[8] < -1e-3 for contact in world.bullet.getContactPoints(world.object)):
        return None  # the open hand is in the object already
    try:
        _close(world, closing)
        target = world.command.copy()
        world.set_gravity(randomization.STANDARD_GRAVITY)
        for step in range(HOLDING_STEPS):
            if step == HOLDING_STEPS // 2:
                before, turned = world.position, world.rotation
            world.step(target)
    except PhysicsFault:
        return None
    near, still = (
        np.linalg.norm(world.position) < MAX_OFFSET,
        np.linalg.norm(world.position - before) < MAX_DRIFT,
    )
    if not (near and still and geodesic(world.rotation, turned) < MAX_TURN):
        return None
    return Grasp(world.joints.copy(), world.command.copy(), world.position.copy(), world.rotation.copy())


@dataclass(frozen=True)
class GraspBank:
    """Grasps of several objects: arrays over all grasps and the first grasp of each object.

    ``joints (G, 16)``, ``command (G, 12)``, ``position (G, 3)``, ``rotation (G, 3, 3)``, ``start (N + 1,)``.
    """

    joints: Array
    command: Array
    position: Array
    rotation: Array
    start: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.start) - 1

    def count(self, index: int) -> int:
        """Number of grasps of object ``index``."""
        return int(self.start[index + 1] - self.start[index])

    @classmethod
    def joined(cls, banks: Sequence[GraspBank]) -> GraspBank:
        """One bank over the objects of several."""
        counts = [bank.count(index) for bank in banks for index in range(len(bank))]
        arrays = {
            name: np.concatenate([getattr(bank, name) for bank in banks]) for name in Grasp.__annotations__
        }
        return cls(**arrays, start=np.cumsum([0, *counts]))

    def grasp(self, index: int, number: int) -> Grasp:
        """Grasp ``number`` of object ``index``."""
        if not 0 <= number < self.count(index):
            raise IndexError(f"grasp {number} of object {index}: allowed are 0 to {self.count(index) - 1}")
        at = int(self.start[index]) + number
        return Grasp(self.joints[at], self.command[at], self.position[at], self.rotation[at])


def find_grasps(
    world: World, thing: Object, count: int, seed: int = 0, attempts: int = 60, spread: float = 0.0
) -> list[Grasp]:
    """``count`` grasps of ``thing``, each from a random orientation; reproducible from ``seed``.

    With a ``spread`` (rad) they resemble the moments between two grasps: fingers stray from the heuristic's posture by
    up to so much, and in a third of them one finger stays open.

    Raises:
        GraspError: fewer than ``count`` grasps in ``attempts * count`` tries.
    """
    body, found = Body(thing), []
    generator = randomization.stream(seed, "grasps", thing.digest)
    for rotation in random_rotations(generator, attempts * count):
        if spread:
            offset = spread * generator.uniform(-1, 1, (kinematics.FINGERS, 3)) * [1.0, 0.5, 0.5]
            idle = generator.integers(3 * kinematics.FINGERS)  # no finger from 4 on
            closing = np.arange(kinematics.FINGERS) != idle
            grasp = try_grasp(world, body, rotation, offset.ravel(), closing)
        else:
            grasp = try_grasp(world, body, rotation)
        if grasp is not None:
            found.append(grasp)
        if len(found) == count:
            return found
    raise GraspError(
        f"{thing.name} with extents {np.round(thing.extents * 1000, 1)} mm: {len(found)} of {count} grasps held in "
        f"{attempts * count} tries",
        thing.name,
    )


def _bank_file(thing: Object, count: int, seed: int, config: SimulationConfig, spread: float) -> Path:
    physics = config.model_dump(
        exclude={"engine", "support", "drag"}
    )  # grasps are found in Bullet, without support
    settings = json.dumps(
        [RECIPE, thing.digest, count, seed, spread, physics, urdf.hand_urdf()], sort_keys=True
    )
    return cache_directory() / "grasps" / f"{hashlib.sha256(settings.encode()).hexdigest()[:24]}.npz"


def _save(path: Path, grasps: Sequence[Grasp]) -> None:
    write_atomic(
        path, npz_bytes({n: np.stack([getattr(g, n) for g in grasps]) for n in Grasp.__annotations__})
    )


def grasps_of(
    things: Sequence[Object],
    count: int,
    config: SimulationConfig,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
    spread: float = 0.0,
) -> GraspBank:
    """The bank of ``count`` grasps for each of ``things``, read from the cache where it is there.

    Grasps are looked for at the coarsest step: they are starting states, and every episode lets them settle.
    """
    world, rows = None, []
    for index, thing in enumerate(things):
        path = _bank_file(thing, count, seed, config, spread)
        if not path.exists():
            world = world or World(config)
            _save(path, find_grasps(world, thing, count, seed, spread=spread))
        with np.load(path, allow_pickle=False) as data:
            rows.append({name: data[name] for name in Grasp.__annotations__})
        if progress:
            progress(index + 1, len(things))
    if world is not None:
        world.close()
    start = np.cumsum([0] + [len(row["joints"]) for row in rows])
    return GraspBank(
        **{name: np.concatenate([row[name] for row in rows]) for name in Grasp.__annotations__}, start=start
    )
