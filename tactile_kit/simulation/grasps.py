"""Initial states: a randomly turned object, and four fingers closed around it until each feels it.

Every fingertip moves towards the object's centre while the object is held in its place; then it is let go.

The paper (section II-E) spawns a randomly oriented object in the hand and closes the fingers by a heuristic. Grasps are
found once an object and size and kept in a bank (simulation/banks.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import randomization
from object_sets import Object
from tactile_kit.hand import inverse, kinematics
from tactile_kit.rotations import geodesic, random_rotations
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.config import command_share
from tactile_kit.simulation.world import Grasp, PhysicsFault, World

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
MAX_INSIDE = 1e-3  # m of the open hand in the object
ATTEMPTS = 60  # tries a grasp before an object counts as one that can't be held
RECIPE = 7  # counts changes of this file and of the physics that give other grasps
ALL = np.ones(kinematics.FINGERS, bool)


class GraspError(ValueError):
    """An object can't be held: too few grasps were found of the one named ``thing``."""

    def __init__(self, message: str, thing: str = "") -> None:
        super().__init__(message)
        self.thing = thing

    def __reduce__(self) -> tuple:
        return type(self), (self.args[0], self.thing)


def opened(offset: Array | float) -> Array:
    """Joint angles ``(..., 12)`` rad with the fingertips away from the object, moved by ``offset (..., 12)``."""
    home = inverse.tips(kinematics.MEAN_GRASP)
    away = home * (1.0 + OPENING / np.linalg.norm(home, axis=1, keepdims=True))
    angles = inverse.joints_for(away, kinematics.MEAN_GRASP) + offset
    return np.clip(angles, kinematics.JOINT_LOWER, kinematics.JOINT_UPPER)


def _close(world: World, closing: NDArray[np.bool_]) -> None:
    """Bring the tips of ``closing (4,)`` to the centre of the object, which is held, until each feels it."""
    put_back = world.pin()
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
        put_back()


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
    start = opened(offset)
    world.place(Grasp(kinematics.expand(start), start, np.zeros(3), rotation))
    if world.overlap(anew=True) > MAX_INSIDE:
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
    if not rests(world.position, world.rotation, before, turned):
        return None
    return Grasp(world.joints.copy(), world.command.copy(), world.position.copy(), world.rotation.copy())


def rests(position: Array, rotation: Array, before: Array, turned: Array) -> NDArray[np.bool_]:
    """Whether an object is held, from its pose ``(..., 3)``, ``(..., 3, 3)`` now and half a second before."""
    near = np.linalg.norm(position, axis=-1) < MAX_OFFSET
    still = np.linalg.norm(position - before, axis=-1) < MAX_DRIFT
    return np.asarray(near & still & (geodesic(rotation, turned) < MAX_TURN))


@dataclass(frozen=True)
class Tries:
    """Ways to close: the object's ``rotation (n, 3, 3)``, ``offset (n, 12)`` rad and the ``closing (n, 4)`` fingers."""

    rotation: Array
    offset: Array
    closing: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.rotation)

    def part(self, first: int, last: int) -> Tries:
        """From number ``first`` to before ``last``."""
        return Tries(self.rotation[first:last], self.offset[first:last], self.closing[first:last])


def draw_tries(thing: Object, count: int, seed: int, attempts: int, spread: float) -> Tries:
    """All ``attempts * count`` tries for ``count`` grasps of ``thing``, in their order; see :func:`find_grasps`."""
    generator, number = randomization.stream(seed, "grasps", thing.digest), attempts * count
    rotation = random_rotations(generator, number)
    offset, closing = np.zeros((number, kinematics.JOINTS)), np.ones((number, kinematics.FINGERS), bool)
    if spread:
        for at in range(number):
            stray = spread * generator.uniform(-1, 1, (kinematics.FINGERS, 3)) * [1.0, 0.5, 0.5]
            idle = generator.integers(3 * kinematics.FINGERS)  # no finger from 4 on
            offset[at], closing[at] = stray.ravel(), np.arange(kinematics.FINGERS) != idle
    return Tries(rotation, offset, closing)


def too_few(thing: Object, found: int, count: int, tries: int) -> GraspError:
    """What to raise for an object that can't be held."""
    return GraspError(
        f"{thing.name} with extents {np.round(thing.extents * 1000, 1)} mm: {found} of {count} grasps held in "
        f"{tries} tries",
        thing.name,
    )


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
    world: World, thing: Object, count: int, seed: int = 0, attempts: int = ATTEMPTS, spread: float = 0.0
) -> list[Grasp]:
    """``count`` grasps of ``thing``, each from a random orientation; reproducible from ``seed``.

    With a ``spread`` (rad) they resemble the moments between two grasps: fingers stray from the heuristic's posture by
    up to so much, and in a third of them one finger stays open.

    Raises:
        GraspError: fewer than ``count`` grasps in ``attempts * count`` tries.
    """
    body, found = Body(thing), []
    tries = draw_tries(thing, count, seed, attempts, spread)
    for rotation, offset, closing in zip(tries.rotation, tries.offset, tries.closing, strict=True):
        grasp = try_grasp(world, body, rotation, offset, closing)
        if grasp is not None:
            found.append(grasp)
        if len(found) == count:
            return found
    raise too_few(thing, len(found), count, len(tries))
