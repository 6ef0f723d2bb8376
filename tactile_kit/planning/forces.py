"""What fingertips bear, and how holding fingers take over what lifted ones bore; compiled."""

from __future__ import annotations

import math

import numba
import numpy as np

from tactile_kit.hand.inverse import TIP, tip_of

STIFFNESS = 4.17  # Nm/rad: of the controller (5) and the joint (25) in series
LIMIT = 1.0  # Nm
TIP_RADIUS = 0.014  # m
SHARE = 0.5  # of what a lifted finger bears that the others take over at once
LEVER = 0.03  # m by which torques are weighed against forces
BALANCE = 30.0  # weight of an unbalanced force against a change of the fingers' forces
LEAST = 1.0  # N that a holding finger presses with at least
CONE = 0.6  # most force along the surface, as a share of the pressing one
CORRECTIONS = 4
FARTHEST = 0.15  # rad of a change of the command
SINGULAR = 2e-5  # m^2


@numba.njit(cache=True)
def _unit(vector):
    return vector / max(math.sqrt((vector * vector).sum()), 1e-9)


@numba.njit(cache=True)
def taken_over(origins, q, command, x, lifted):
    """Change of command ``(4, 3)`` rad by which the other fingers take over what the ``lifted (4,)`` bear.

    The least change of fingertip forces that keeps force and torque on the object as they are without the lifted
    fingers, with every holding finger pressing inwards enough for its friction (the surface's normal is taken to point
    away from the object's centre ``x``). ``q`` and ``command`` are ``(4, 3)`` rad.
    """
    change = np.zeros((4, 3))
    jacobians, force, inwards = np.zeros((4, 3, 3)), np.zeros((4, 3)), np.zeros((4, 3))
    grasp, missing = np.zeros((6, 12)), np.zeros(6)
    for f in range(4):
        tip, J = tip_of(origins[f], q[f], TIP)
        torque = np.minimum(np.maximum(STIFFNESS * (command[f] - q[f]), -LIMIT), LIMIT)
        force[f] = np.linalg.solve(J @ J.T + SINGULAR * np.eye(3), J @ torque)
        jacobians[f], inwards[f] = J, _unit(x - tip)
        rx, ry, rz = (tip + TIP_RADIUS * inwards[f] - x) / LEVER
        lever = np.array([[0.0, -rz, ry], [rz, 0.0, -rx], [-ry, rx, 0.0]])
        if lifted[f]:
            missing[:3] += force[f]
            missing[3:] += lever @ force[f]
        else:
            grasp[:3, 3 * f : 3 * f + 3] = np.eye(3)
            grasp[3:, 3 * f : 3 * f + 3] = lever
    normal_matrix, right = BALANCE * (grasp.T @ grasp) + np.eye(12), BALANCE * (grasp.T @ missing)
    delta = np.linalg.solve(normal_matrix, right)
    for _ in range(CORRECTIONS):
        enough = True
        for f in range(4):
            part = slice(3 * f, 3 * f + 3)
            total = force[f] + delta[part]
            pressing = (total * inwards[f]).sum()
            along = total - pressing * inwards[f]
            wanted = max(LEAST, math.sqrt((along * along).sum()) / CONE)
            if not lifted[f] and pressing < wanted - 0.05:
                enough = False
                normal_matrix[part, part] += 3.0 * np.outer(inwards[f], inwards[f])
                right[part] += 3.0 * (wanted - (force[f] * inwards[f]).sum()) * inwards[f]
        if enough:
            break
        delta = np.linalg.solve(normal_matrix, right)
    for f in range(4):
        if not lifted[f]:
            step = SHARE * jacobians[f].T @ delta[3 * f : 3 * f + 3] / STIFFNESS
            change[f] = np.minimum(np.maximum(step, -FARTHEST), FARTHEST)
    return change
