"""The feedback laws of moves, compiled: where a gait's fingers should go next. See ``gait``."""

from __future__ import annotations

import math

import numba
import numpy as np

from tactile_kit.hand.inverse import LOWER, TIP, UPPER, solve, tips_of
from tactile_kit.planning.forces import taken_over

# Columns of a move's row after the four of lifted fingers
TURN, TURN_LIFTED, BACK, OFFSET, RAISED, AXES, TILT, SQUEEZE, PACE, STEPS, REST = (
    4, 5, 6, 7, 10, 11, 14, 17, 18, 19, 20,
)  # fmt: skip
CENTRE = np.array([-0.004, 0.004, 0.006])  # m: between the tips, where all can reach around the object
CLEARANCE = 0.02  # m a lifted tip keeps from where it touched
APPROACH = 0.009  # m a control step towards the object
LANDED = 0.002  # m a closing finger's command may lead its tip beyond the squeeze
PATIENCE = 6  # control steps a finger may close
RECENTRING = 0.1  # share of the object's distance from the centre taken back in a step
FARTHEST = 0.002  # m of it
LONGEST_LEAD = 0.015  # m that a command leads its tip by along the surface
ARRIVED = 0.08  # rad: no need to turn
TILTED = 0.3  # rad that a tilted turn goes at least


@numba.njit(cache=True)
def rotation_vector(R):
    """Rotation vector ``(3,)`` rad of ``R (3, 3)``, by way of the quaternion's largest entry."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    q = np.empty(4)
    if trace > 0.0:
        q[3] = 1.0 + trace
        q[0], q[1], q[2] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    else:
        i = 0
        if R[1, 1] > R[0, 0]:
            i = 1
        if R[2, 2] > R[i, i]:
            i = 2
        j, k = (i + 1) % 3, (i + 2) % 3
        q[i] = 1.0 + R[i, i] - R[j, j] - R[k, k]
        q[j], q[k], q[3] = R[j, i] + R[i, j], R[k, i] + R[i, k], R[k, j] - R[j, k]
    if q[3] < 0.0:
        q = -q
    sine = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2)
    if sine < 1e-12:
        return np.zeros(3)
    return q[:3] * (2.0 * math.atan2(sine, q[3]) / sine)


@numba.njit(cache=True)
def rotation_about(axis, angle):
    """Rotation ``(3, 3)`` by ``angle`` rad about the unit vector ``axis``."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s
    R[1, 0], R[1, 1], R[1, 2] = y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s
    R[2, 0], R[2, 1], R[2, 2] = z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)
    return R


@numba.njit(cache=True)
def _turn(move, lifting, R, goal):
    """Unit axis to turn about and the angle by which holding fingers lead."""
    way = rotation_vector(goal @ R.T)
    angle = math.sqrt((way * way).sum())
    way = way * move[AXES : AXES + 3]
    length = math.sqrt((way * way).sum())
    axis = way / max(length, 1e-9)
    tilt = move[TILT : TILT + 3]
    if (tilt != 0.0).any():
        axis = axis + tilt
        axis = axis / math.sqrt((axis * axis).sum())
        length = max(length, TILTED)
    lead = move[TURN_LIFTED] if lifting else move[TURN]
    return axis, (0.0 if angle < ARRIVED else min(lead, length, angle))


@numba.njit(cache=True)
def _length(vector):
    return max(math.sqrt((vector * vector).sum()), 1e-9)


@numba.njit(cache=True)
def lifted(move, stage, left, tip, commanded, home, x, axis):
    """Where a lifted finger goes, and whether it holds again: away, over to its landing place, in until it feels."""
    pace = int(move[PACE])
    away = left - x
    if stage < pace:
        lever = tip - x
        return left + lever * (CLEARANCE * (stage + 1) / pace / _length(lever)), False
    if stage < 2 * pace:
        start = away * (1.0 + CLEARANCE / _length(away))
        place = home - CENTRE
        place[2] += move[RAISED]
        landing = CENTRE + rotation_about(axis, -move[BACK]) @ place + move[OFFSET : OFFSET + 3] - x
        hover = landing * (1.0 + CLEARANCE / _length(landing))
        way = start + (stage + 1 - pace) / pace * (hover - start)
        least = min(_length(start), _length(hover))
        return x + way * max(1.0, least / _length(way)), False  # around the object, not through it
    inwards = (x - commanded) / _length(x - commanded)
    target = commanded + APPROACH * inwards
    lead = ((target - tip) * inwards).sum()
    felt = lead > move[SQUEEZE] + LANDED and stage > 2 * pace
    return target, felt or stage >= 2 * pace + PATIENCE


@numba.njit(cache=True)
def holding(tip, commanded, x, turn, longest):
    """Where the command of a holding finger goes: on with the object. It never follows the tip, since what the tip lags
    behind by is the force that holds the object in its place (following it, twice as many lifts dropped it)."""
    lever = tip - x
    outwards = lever / _length(lever)
    lead = commanded - tip
    inside = -(lead * outwards).sum()
    along = lead + inside * outwards + turn @ lever - lever
    for i in range(3):
        along[i] += min(max(RECENTRING * (CENTRE[i] - x[i]), -FARTHEST), FARTHEST)
    along *= min(1.0, longest / _length(along))
    return tip + along - inside * outwards


@numba.njit(cache=True)
def wanted(origins, home, moves, stages, played, lefts, q, command, x, R, goal):
    """Joint angles ``(E, 12)`` rad that the command should have after the next control step; advances the stages."""
    out = np.empty_like(q)
    for e in range(len(q)):
        move, stage = moves[e], stages[e]
        if move[REST] > 0:
            out[e] = command[e]
            continue
        tips = tips_of(origins, q[e].reshape(4, 3), TIP)
        commanded = tips_of(origins, command[e].reshape(4, 3), TIP)
        if played[e] == 0:
            lefts[e] = tips
        axis, lead = _turn(move, (stage >= 0).any(), R[e], goal[e])
        turn = rotation_about(axis, lead)
        targets = np.empty((4, 3))
        for f in range(4):
            if stage[f] >= 0:
                targets[f], holds = lifted(
                    move, stage[f], lefts[e, f], tips[f], commanded[f], home[f], x[e], axis
                )
                stage[f] = -1 if holds else stage[f] + 1
                continue
            targets[f] = holding(tips[f], commanded[f], x[e], turn, LONGEST_LEAD)
        angles = solve(origins, q[e].reshape(4, 3), targets, LOWER, UPPER, TIP)
        if played[e] == 0:
            angles += taken_over(origins, q[e].reshape(4, 3), command[e].reshape(4, 3), x[e], move[:4] > 0)
        out[e] = angles.ravel()
    return out
