"""Finger gaits as moves: what the planner chooses from.

A move turns the object a little with all fingers that hold, or lifts one or two opposite fingers, carries them back
against the turn and closes them again while the others hold. Each is a feedback law on the true state: where every
fingertip should go, by inverse kinematics, through the inverse of the command filter.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand import inverse
from tactile_kit.hand.kinematics import DRIVEN_INDEX, FINGERS, MEAN_GRASP
from tactile_kit.simulation.config import CONTROL_RATE
from tactile_kit.simulation.simulator import FULL_RANGE, MIDDLE
from tactile_kit.simulation.world import World
from tactile_kit.task.rotations import exp, log

Array = NDArray[np.float64]

OPPOSITE = (2, 3, 0, 1)  # the finger across the object
LIFTS = ((0, 2), (1, 3), (0,), (1,), (2,), (3,))  # that leave the object held
CENTRE = np.array([-0.004, 0.004, 0.006])  # m: between the tips, where all can reach around the object
CLEARANCE = 0.02  # m a lifted tip keeps from where it touched
APPROACH = 0.009  # m a control step towards the object
SOFT = 0.004  # m: squeeze of a finger whose opposite is lifted
LANDED = 0.002  # m a closing finger's command may lead its tip beyond the squeeze
PATIENCE = 6  # control steps a finger may close
RECENTRING = 0.3  # share of the object's distance from the centre taken back in a step
FARTHEST = 0.01  # m of it
ARRIVED = 0.08  # rad: no need to turn


@dataclass(frozen=True)
class Move:
    """One piece of a gait.

    Attributes:
        lifted: fingers that are lifted and put back; none: all hold.
        turn: rad that holding fingers lead the object by; while others are lifted ``turn_lifted``.
        back: rad against the turn that lifted fingers are put back by, and ``offset (3,)`` m beyond.
        raised: m above the mean grasp where they are put.
        axes: mask of the world axes about which to turn.
        tilt: added to the direction to the goal before its length is taken out.
        squeeze: m that the command of a holding tip goes into the object.
        pace: control steps to lift, and again to carry.
        steps: least number of control steps.
        rest: keep the command as it is, instead of all this.
    """

    lifted: tuple[int, ...] = ()
    turn: float = 0.3
    turn_lifted: float = 0.0
    back: float = 0.0
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    raised: float = 0.006
    axes: tuple[float, ...] = (1.0, 1.0, 1.0)
    tilt: tuple[float, ...] = (0.0, 0.0, 0.0)
    squeeze: float = 0.012
    pace: int = 2
    steps: int = 3
    rest: bool = False


def random_move(generator: np.random.Generator) -> Move:
    """A move with everything drawn; three in four lift fingers."""
    choice = int(generator.integers(len(LIFTS) + 2))
    lifted = LIFTS[choice] if choice < len(LIFTS) else ()
    axes = ((1.0, 1.0, 1.0), (1.0, 1.0, 1.0), (0.0, 0.0, 1.0), (1.0, 1.0, 0.0))
    strays, tilts = generator.random() < 0.7, generator.random() < 0.25
    return Move(
        lifted=lifted,
        turn=generator.uniform(0.1, 0.5),
        turn_lifted=float(generator.choice([0.0, 0.15, 0.3])),
        back=generator.uniform(0.0, 0.8),
        offset=tuple(generator.normal(0.0, 0.008, 3) * strays),
        raised=generator.uniform(0.0, 0.02),
        axes=axes[int(generator.integers(len(axes)))],
        tilt=tuple(generator.normal(0.0, 0.7, 3) * tilts),
        squeeze=generator.uniform(0.006, 0.018),
        pace=int(generator.integers(1, 4)),
        steps=5 if lifted else 3,
    )


class Gait:
    """Plays moves, one after the other, on the true state of a world."""

    def __init__(self, filter_time_constant: float) -> None:
        self._share = 1.0 - np.exp(-1.0 / (CONTROL_RATE * filter_time_constant))  # of a target, after a step
        self.home = inverse.tips(MEAN_GRASP)
        self.begin(Move(rest=True, steps=0))

    def begin(self, move: Move) -> None:
        """Start ``move``."""
        self.move, self.played = move, 0
        self._stage = [0 if finger in move.lifted else -1 for finger in range(FINGERS)]  # -1: holds
        self._left: Array | None = None  # where the tips were when the move began

    @property
    def done(self) -> bool:
        """Whether the move is over."""
        return self.played >= self.move.steps and max(self._stage) < 0

    def copy(self) -> Gait:
        """The same moment of the same move, to be played on independently."""
        twin = copy.copy(self)
        twin._stage = list(self._stage)
        return twin

    def action(self, world: World, goal: Array) -> Array:
        """The next action ``(12,)`` in [-1, 1] towards the goal orientation ``(3, 3)``."""
        self.played += 1
        command, move = world.command, self.move
        if move.rest:
            return (command - MIDDLE) / FULL_RANGE
        joints = world.joints[DRIVEN_INDEX]
        tips = inverse.tips(joints)
        if self._left is None:
            self._left = tips
        axis, lead = self._turn(world, goal)
        targets = self._holding(tips, world.position, exp(axis * lead))
        for finger in range(FINGERS):
            if self._stage[finger] >= 0:
                targets[finger] = self._lifted(
                    finger, tips[finger], inverse.tips(command)[finger], world.position, axis
                )
        wanted = inverse.joints_for(targets, joints)
        return np.clip((command + (wanted - command) / self._share - MIDDLE) / FULL_RANGE, -1.0, 1.0)

    def _turn(self, world: World, goal: Array) -> tuple[Array, float]:
        """Axis ``(3,)`` to turn about and the angle by which holding fingers lead."""
        move = self.move
        way = log(goal @ world.rotation.T)
        angle = float(np.linalg.norm(way))
        way = way * np.array(move.axes)
        length = float(np.linalg.norm(way))
        axis = way / max(length, 1e-9)
        if any(move.tilt):
            axis = axis + np.array(move.tilt)
            axis /= np.linalg.norm(axis)
            length = max(length, 0.3)
        lead = move.turn_lifted if max(self._stage) >= 0 else move.turn
        return axis, 0.0 if angle < ARRIVED else min(lead, length, angle)

    def _holding(self, tips: Array, position: Array, turn: Array) -> Array:
        """Targets ``(4, 3)`` m of fingers that hold: carried on with the object, and into it."""
        lifted = [finger for finger in range(FINGERS) if self._stage[finger] >= 0]
        squeeze = np.full(FINGERS, self.move.squeeze)
        if len(lifted) == 1:
            squeeze[OPPOSITE[lifted[0]]] = SOFT
        levers = tips - position
        outwards = levers / np.linalg.norm(levers, axis=1, keepdims=True)
        shift = np.clip(RECENTRING * (CENTRE - position), -FARTHEST, FARTHEST)
        return position + levers @ turn.T + shift - squeeze[:, None] * outwards

    def _lifted(self, finger: int, tip: Array, commanded: Array, position: Array, axis: Array) -> Array:
        """Target ``(3,)`` m of a lifted finger: away, over to its landing place, and in until it feels the object."""
        move, stage = self.move, self._stage[finger]
        assert self._left is not None
        left = _away(self._left[finger] - position, CLEARANCE)
        home = self.home[finger] + np.array([0.0, 0.0, move.raised])
        landing = CENTRE + exp(-axis * move.back) @ (home - CENTRE) + np.array(move.offset)
        hover = _away(landing - position, CLEARANCE)
        self._stage[finger] += 1
        if stage < move.pace:
            outwards = (tip - position) / np.linalg.norm(tip - position)
            return self._left[finger] + outwards * CLEARANCE * (stage + 1) / move.pace
        if stage < 2 * move.pace:
            way = left + (stage + 1 - move.pace) / move.pace * (hover - left)
            far, least = np.linalg.norm(way), np.linalg.norm([left, hover], axis=1).min()
            return position + way * max(1.0, least / far)  # around the object, not through it
        inwards = (position - commanded) / np.linalg.norm(position - commanded)
        target = commanded + APPROACH * inwards
        landed = (target - tip) @ inwards > move.squeeze + LANDED and stage > 2 * move.pace
        if landed or stage >= 2 * move.pace + PATIENCE:
            self._stage[finger] = -1
        return target


def _away(lever: Array, distance: float) -> Array:
    """``lever (3,)`` longer by ``distance``."""
    return lever * (1.0 + distance / np.linalg.norm(lever))
