"""Gaits as a space of actions: at every control step a policy says how to turn and which finger to put elsewhere.

The same laws as a planner's moves (``laws``), one control step at a time. An action of zeros holds the object with all
fingers and turns it towards the goal; a finger that is lifted is carried over and closed by itself, in about half a
second. The policy learns when to lift which finger, where to put it, and how else to turn.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand import inverse
from tactile_kit.hand.inverse import LOWER, TIP, UPPER, solve, tips_of
from tactile_kit.hand.kinematics import FINGERS, MEAN_GRASP
from tactile_kit.planning.forces import taken_over
from tactile_kit.planning.laws import (
    BACK,
    PACE,
    RAISED,
    SQUEEZE,
    holding,
    lifted,
    rotation_about,
    rotation_vector,
)
from tactile_kit.simulation.config import command_share
from tactile_kit.task.actions import absolute, measured

Array = NDArray[np.float64]

TURN = 0.06  # rad a control step towards the goal
TURN_LIFTED = 0.03  # the same while a finger is lifted
FASTEST = 0.18  # rad a control step
AROUND = 0.12  # rad a control step that an action of 1 adds about an axis
LIFT = 0.6  # action above which a finger is lifted
BACKWARDS = 0.3  # rad against the turn that a lifted finger is put back by
ELSEWHERE = 0.6  # rad about the object that an action of 1 puts it elsewhere
SQUEEZED, SQUEEZE_RANGE = 0.011, 0.006  # m that the command of a landing tip goes into the object
RAISED_BY, RAISE_RANGE = 0.006, 0.012  # m above the mean grasp where it is put
HOLDING = 2  # fingers that are never lifted together with the others
LONGEST_LEAD = 0.009  # m that a command leads its tip by along the surface
STARTLED = 0.008  # m the object has moved since a finger was lifted: it closes at once
STEPS = 2.0  # control steps to lift, and again to carry
ROW = 21  # numbers of a move
FINGER, PLACE, PRESS, HEIGHT = 3, 7, 10, 11  # columns of an action


@numba.njit(cache=True)
def _plan(move, action, toward):
    """What is decided when a finger is lifted: where it lands, as a rotation about the object, and how firmly."""
    place = ELSEWHERE * action[PLACE : PLACE + 3] - BACKWARDS * toward
    move[BACK] = math.sqrt((place * place).sum())
    move[PACE] = STEPS
    move[SQUEEZE] = SQUEEZED + SQUEEZE_RANGE * action[PRESS]
    move[RAISED] = RAISED_BY + RAISE_RANGE * action[HEIGHT]
    return -place / max(move[BACK], 1e-9)


@numba.njit(cache=True)
def _wanted(origins, home, actions, moves, axes, stages, lefts, starts, q, command, x, R, goal):
    """Joint angles ``(E, 12)`` rad that the command should have after the next control step; advances the gaits."""
    out = np.empty_like(q)
    for e in range(len(q)):
        action, stage, joints, commands = actions[e], stages[e], q[e].reshape(4, 3), command[e].reshape(4, 3)
        tips, commanded = tips_of(origins, joints, TIP), tips_of(origins, commands, TIP)
        way = rotation_vector(goal[e] @ R[e].T)
        angle = math.sqrt((way * way).sum())
        toward = way / max(angle, 1e-9)
        new = np.zeros(4, np.bool_)
        for f in np.argsort(-action[FINGER : FINGER + 4]):
            if action[FINGER + f] > LIFT and stage[f] < 0 and (stage < 0).sum() > HOLDING:
                stage[f], new[f] = 0, True
                lefts[e, f] = tips[f]
                axes[e, f] = _plan(moves[e, f], action, toward)
        if new.any():
            starts[e] = x[e]
        moved = x[e] - starts[e]
        startled = (moved * moved).sum() > STARTLED**2
        speed = min(TURN_LIFTED if (stage >= 0).any() else TURN, angle) * toward + AROUND * action[:FINGER]
        lead = math.sqrt((speed * speed).sum())
        turn = rotation_about(speed / max(lead, 1e-9), min(lead, FASTEST))
        targets = np.empty((4, 3))
        for f in range(4):
            if stage[f] < 0:
                targets[f] = holding(tips[f], commanded[f], x[e], turn, LONGEST_LEAD)
                continue
            if startled:
                stage[f] = max(stage[f], int(2 * STEPS))
            targets[f], holds = lifted(
                moves[e, f], stage[f], lefts[e, f], tips[f], commanded[f], home[f], x[e], axes[e, f]
            )
            stage[f] = -1 if holds else stage[f] + 1
        angles = solve(origins, joints, targets, LOWER, UPPER, TIP)
        if new.any():
            angles += taken_over(origins, joints, commands, x[e], new)
        out[e] = angles.ravel()
    return out


class GaitActions:
    """Turns actions of gaits into actions of joint angles, for ``E`` environments.

    Columns of an action ``(12,)`` in [-1, 1]: 0 to 2 turn further about a world axis; 3 to 6 lift a finger where above
    ``LIFT``; 7 to 9 put it elsewhere, a rotation about the object; 10 how firmly and 11 how high it lands.

    Attributes:
        stage: ``(E, 4)`` control steps since a finger was lifted, -1: it holds.
    """

    def __init__(self, count: int, filter_time_constant: float) -> None:
        self._share = command_share(filter_time_constant)
        self._home = inverse.tips(MEAN_GRASP)
        self.stage = np.full((count, FINGERS), -1, np.int64)
        self._moves = np.zeros((count, FINGERS, ROW))
        self._axes, self._left = np.zeros((count, FINGERS, 3)), np.zeros((count, FINGERS, 3))
        self._starts = np.zeros((count, 3))

    def begin(self, which: NDArray[np.bool_]) -> None:
        """New episodes: all fingers hold."""
        self.stage[which] = -1

    def __call__(
        self, actions: NDArray, z: NDArray, x: NDArray, R: NDArray, goal: NDArray
    ) -> NDArray[np.float32]:
        """See :class:`tactile_kit.task.actions.Actions`."""
        q, command = measured(z)
        finite = np.isfinite(actions).all(axis=1)
        clipped = np.clip(np.where(finite[:, None], actions, 0.0), -1.0, 1.0).astype(np.float64)
        wanted = _wanted(
            inverse.ORIGINS, self._home, clipped, self._moves, self._axes, self.stage, self._left, self._starts,
            q, command, *(np.ascontiguousarray(array, np.float64) for array in (x, R, goal)),
        )  # fmt: skip
        out = absolute(command + (wanted - command) / self._share)
        out[~finite] = np.nan
        return out
