"""Finger gaits as moves: what the planner and the agents over moves choose from.

A move turns the object a little with all fingers that hold, or lifts one or two opposite fingers, carries them back
against the turn and closes them again while the others hold. Each is a feedback law on the true state: where every
fingertip should go, by inverse kinematics, through the inverse of the command filter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand import inverse
from tactile_kit.hand.kinematics import DRIVEN_INDEX, FINGERS, JOINTS, MEAN_GRASP
from tactile_kit.planning import laws
from tactile_kit.simulation.config import command_share
from tactile_kit.simulation.episode import FULL_RANGE, MIDDLE
from tactile_kit.simulation.world import World

Array = NDArray[np.float64]

LIFTS = ((0, 2), (1, 3), (0,), (1,), (2,), (3,))  # that leave the object held
EVERYWHERE, UPRIGHT, LEVEL = (1.0, 1.0, 1.0), (0.0, 0.0, 1.0), (1.0, 1.0, 0.0)


@dataclass(frozen=True)
class Move:
    """One piece of a gait.

    Attributes:
        lifted: fingers that are lifted and put back; none: all hold.
        turn: rad a control step that holding fingers go on; while others are lifted ``turn_lifted``.
        back: rad against the turn that lifted fingers are put back by, and ``offset (3,)`` m beyond.
        raised: m above the mean grasp where they are put.
        axes: mask of the world axes about which to turn.
        tilt: added to the direction to the goal before its length is taken out.
        squeeze: m that the command of a landing tip goes into the object.
        pace: control steps to lift, and again to carry.
        steps: least number of control steps.
        rest: keep the command as it is, instead of all this.
    """

    lifted: tuple[int, ...] = ()
    turn: float = 0.1
    turn_lifted: float = 0.0
    back: float = 0.0
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    raised: float = 0.006
    axes: tuple[float, ...] = EVERYWHERE
    tilt: tuple[float, ...] = (0.0, 0.0, 0.0)
    squeeze: float = 0.012
    pace: int = 2
    steps: int = 3
    rest: bool = False


def random_move(generator: np.random.Generator) -> Move:
    """A move with everything drawn; three in four lift fingers."""
    choice = int(generator.integers(len(LIFTS) + 2))
    lifted = LIFTS[choice] if choice < len(LIFTS) else ()
    axes = (EVERYWHERE, EVERYWHERE, UPRIGHT, LEVEL)
    strays, tilts = generator.random() < 0.7, generator.random() < 0.25
    return Move(
        lifted=lifted,
        turn=generator.uniform(0.03, 0.15),
        turn_lifted=float(generator.choice([0.0, 0.05, 0.1])),
        back=generator.uniform(0.0, 0.8),
        offset=tuple(generator.normal(0.0, 0.008, 3) * strays),
        raised=generator.uniform(0.0, 0.02),
        axes=axes[int(generator.integers(len(axes)))],
        tilt=tuple(generator.normal(0.0, 0.7, 3) * tilts),
        squeeze=generator.uniform(0.006, 0.018),
        pace=int(generator.integers(1, 4)),
        steps=5 if lifted else 3,
    )


def _row(move: Move) -> list[float]:
    """A move as the numbers that ``laws`` reads."""
    lifted = [float(finger in move.lifted) for finger in range(FINGERS)]
    values: list[float] = []
    for value in astuple(move)[1:]:
        values += value if isinstance(value, tuple) else [float(value)]
    return lifted + values


class Gaits:
    """``E`` gaits side by side, each playing one move after the other on the true state it is given.

    Attributes:
        stage: ``(E, 4)`` control steps since a finger was lifted, -1: it holds.
        played: ``(E,)`` control steps of the present moves.
    """

    def __init__(self, count: int, filter_time_constant: float) -> None:
        self._share = command_share(filter_time_constant)
        self._home = inverse.tips(MEAN_GRASP)
        self.stage = np.full((count, FINGERS), -1, np.int64)
        self.played = np.zeros(count, np.int64)
        self._left = np.zeros((count, FINGERS, 3))  # where the tips were when the move began
        self._rows = np.tile(np.array(_row(Move(rest=True, steps=0))), (count, 1))

    @property
    def done(self) -> NDArray[np.bool_]:
        """Whose move is over, ``(E,)``."""
        return (self.played >= self._rows[:, laws.STEPS]) & (self.stage.max(axis=1) < 0)

    def begin(self, which: Sequence[int] | NDArray[np.int64], moves: Sequence[Move]) -> None:
        """Start ``moves``, one for each gait of ``which``."""
        if len(moves):
            self._rows[which] = [_row(move) for move in moves]
            self.stage[which] = np.where(self._rows[which, :FINGERS] > 0, 0, -1)
            self.played[which] = 0

    def actions(self, q: Array, command: Array, x: Array, R: Array, goal: Array) -> Array:
        """The next actions ``(E, 12)`` in [-1, 1].

        Args:
            q: driven joint angles ``(E, 12)`` rad.
            command: filtered command ``(E, 12)`` rad.
            x, R: of the object, ``(E, 3)`` m, ``(E, 3, 3)``.
            goal: orientations ``(E, 3, 3)``.
        """
        wanted = laws.wanted(
            inverse.ORIGINS, self._home, self._rows, self.stage, self.played, self._left,
            np.ascontiguousarray(q, np.float64), np.ascontiguousarray(command, np.float64),
            np.ascontiguousarray(x, np.float64), np.ascontiguousarray(R, np.float64), np.ascontiguousarray(goal),
        )  # fmt: skip
        self.played += 1
        return np.clip((command + (wanted - command) / self._share - MIDDLE) / FULL_RANGE, -1.0, 1.0)


class Gait(Gaits):
    """One gait, on a world."""

    def __init__(self, filter_time_constant: float) -> None:
        super().__init__(1, filter_time_constant)
        self._time_constant = filter_time_constant

    @property
    def over(self) -> bool:
        """Whether the move is over."""
        return bool(self.done[0])

    def start(self, move: Move) -> None:
        """Start ``move``."""
        self.begin([0], [move])

    def fresh(self) -> Gait:
        """Another gait of the same filter."""
        return Gait(self._time_constant)

    def action(self, world: World, goal: Array) -> Array:
        """The next action ``(12,)`` in [-1, 1] towards the goal orientation ``(3, 3)``."""
        joints = world.joints[DRIVEN_INDEX]
        return self.actions(
            joints[None], world.command[None], world.position[None], world.rotation[None], goal[None]
        ).reshape(JOINTS)
