"""The compiled physics: one environment's control step as a single function, without Bullet and without Python.

It solves the problem Bullet's multibody solver solves, for this hand and one object only: velocities after the free
motion are corrected by projected Gauss-Seidel over contact, friction and joint friction rows, then integrated. A
finger has three coordinates (the tendon makes q4 a part of q3) and the mass matrix of the mean grasp; its links touch
the object as rows of spheres; the object is a grid of distances. docs/compiled.md compares it with Bullet.

All kernels live in this one file: numba's cache misses changes in imported ones.
"""

from __future__ import annotations

import math

import numba
import numpy as np

FINGERS, DRIVEN, SAMPLES = 4, 3, 6
BALLS = 5  # spheres a finger: three along the distal capsule, two along the middle one
TIP_BALLS = 3
CONTACTS = FINGERS * BALLS
PAIRS = 6  # of fingers, which may touch each other at their tips
REACH = 0.004  # m: nearer than that, a sphere is a contact to be
ERP = 0.2  # share of a penetration that a physics step makes good, Bullet's default
RESIDUAL = 1e-5  # m/s: no row is corrected by more, solved

# columns of the parameters of an episode
MASS, TIP_FRICTION, LINK_FRICTION, SPIN_FRICTION, GRAVITY, STIFFNESS, LIMIT, GIVE, SUPPORT, KEEP = range(10)
FORCE, TORQUE, MOMENTS, PLACE = 10, 13, 16, 19  # three columns each
PARAMETERS = 22


_OPTIONS = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},  # but not what assumes that everything is finite
}

# Parts of a step. Called, with their many arrays, they would cost a third of the time.
_INSIDE = {**_OPTIONS, "inline": "always"}


@numba.njit(**_OPTIONS)
def lookup(grid, origin, spacing, x, y, z, out):
    """Distance (m) from the object's surface of a point in its frame; its direction goes to ``out (3,)``."""
    n = grid.shape[0]
    gx, gy, gz = (x - origin[0]) / spacing[0], (y - origin[1]) / spacing[1], (z - origin[2]) / spacing[2]
    if not (0.0 <= gx < n - 1 and 0.0 <= gy < n - 1 and 0.0 <= gz < n - 1):
        return 1.0
    i, j, k = int(gx), int(gy), int(gz)
    fx, fy, fz = gx - i, gy - j, gz - k
    distance, a, b, c = 0.0, 0.0, 0.0, 0.0
    for di in range(2):
        wx = fx if di else 1.0 - fx
        for dj in range(2):
            wy = wx * (fy if dj else 1.0 - fy)
            for dk in range(2):
                w = wy * (fz if dk else 1.0 - fz)
                node = grid[i + di, j + dj, k + dk]
                distance += w * node[0]
                a += w * node[1]
                b += w * node[2]
                c += w * node[3]
    length = math.sqrt(a * a + b * b + c * c) + 1e-12
    out[0], out[1], out[2] = a / length, b / length, c / length
    return distance


@numba.njit(**_OPTIONS)
def _rotation(quaternion, R):
    x, y, z, w = quaternion
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)


@numba.njit(**_OPTIONS)
def _turn(quaternion, velocity, dt):
    """Advance ``quaternion`` by the angular part of the ``velocity (6,)`` (world frame) for ``dt`` seconds."""
    speed = math.sqrt(velocity[3] ** 2 + velocity[4] ** 2 + velocity[5] ** 2)
    half = 0.5 * speed * dt
    s = 0.5 * dt if half < 1e-6 else math.sin(half) / speed
    dx, dy, dz, dw = velocity[3] * s, velocity[4] * s, velocity[5] * s, math.cos(half)
    x, y, z, q = quaternion
    a = dw * x + dx * q + dy * z - dz * y
    b = dw * y - dx * z + dy * q + dz * x
    c = dw * z + dx * y - dy * x + dz * q
    d = dw * q - dx * x - dy * y - dz * z
    norm = 1.0 / math.sqrt(a * a + b * b + c * c + d * d)
    quaternion[0], quaternion[1], quaternion[2], quaternion[3] = a * norm, b * norm, c * norm, d * norm


@numba.njit(**_OPTIONS)
def pose_finger(base, lengths, q1, q2, q3, axes, points, along):
    """Forward kinematics of a finger with ``base (4, 3)`` (axes as rows, then origin).

    Writes ``axes (2, 3)`` (abduction, flexion), ``points (3, 3)`` (origin, third and fourth joint) and ``along (3, 3)``
    (directions of the proximal, middle and distal link).
    """
    s1, c1 = math.sin(q1), math.cos(q1)
    turn = (q2, q2 + q3, q2 + 2.0 * q3)
    for k in range(3):
        u = c1 * base[0, k] + s1 * base[1, k]
        axes[0, k] = base[2, k]
        axes[1, k] = s1 * base[0, k] - c1 * base[1, k]
        for link in range(3):
            along[link, k] = math.cos(turn[link]) * u + math.sin(turn[link]) * base[2, k]
        points[0, k] = base[3, k]
        points[1, k] = base[3, k] + lengths[0] * along[0, k]
        points[2, k] = points[1, k] + lengths[1] * along[1, k]


@numba.njit(**_OPTIONS)
def _lever(axis, at, point, direction):
    """Speed of ``point`` along ``direction`` for a unit speed about ``axis`` through ``at``."""
    x, y, z = point[0] - at[0], point[1] - at[1], point[2] - at[2]
    return (
        direction[0] * (axis[1] * z - axis[2] * y)
        + direction[1] * (axis[2] * x - axis[0] * z)
        + direction[2] * (axis[0] * y - axis[1] * x)
    )


@numba.njit(**_OPTIONS)
def _row(axes, points, point, distal, direction, row):
    """The Jacobian ``row (3,)`` of a point of a finger's middle or distal link along ``direction``."""
    row[0] = _lever(axes[0], points[0], point, direction)
    row[1] = _lever(axes[1], points[0], point, direction)
    row[2] = _lever(axes[1], points[1], point, direction)
    if distal:
        row[2] += _lever(axes[1], points[2], point, direction)


@numba.njit(**_OPTIONS)
def _tangents(n, t1, t2):
    if abs(n[0]) < 0.7:
        norm = 1.0 / math.sqrt(n[1] ** 2 + n[2] ** 2)
        t1[0], t1[1], t1[2] = 0.0, -n[2] * norm, n[1] * norm
    else:
        norm = 1.0 / math.sqrt(n[0] ** 2 + n[1] ** 2)
        t1[0], t1[1], t1[2] = -n[1] * norm, n[0] * norm, 0.0
    t2[0] = n[1] * t1[2] - n[2] * t1[1]
    t2[1] = n[2] * t1[0] - n[0] * t1[2]
    t2[2] = n[0] * t1[1] - n[1] * t1[0]


@numba.njit(**_OPTIONS)
def _drive(command, q, parameters, torque, feedforward, damping, dq):
    """Drive torques ``torque (4, 3)`` of the impedance controller (tactile_kit.hand.controller)."""
    limit = parameters[LIMIT]
    for f in range(FINGERS):
        for i in range(DRIVEN):
            error = min(max(command[f, i] - q[f, i], -limit), limit)
            torque[f, i] = feedforward[f, i] + parameters[STIFFNESS] * error
            for j in range(DRIVEN):
                torque[f, i] -= damping[f, i, j] * dq[f, j]


@numba.njit(**_OPTIONS)
def _speed(dq, f, velocity, JF, JO, c, r):
    """Speed along row ``r`` of contact ``c``, of the finger against the object."""
    return (
        JF[c, r, 0] * dq[f, 0] + JF[c, r, 1] * dq[f, 1] + JF[c, r, 2] * dq[f, 2]
        + JO[c, r, 0] * velocity[0] + JO[c, r, 1] * velocity[1] + JO[c, r, 2] * velocity[2]
        + JO[c, r, 3] * velocity[3] + JO[c, r, 4] * velocity[4] + JO[c, r, 5] * velocity[5]
    )  # fmt: skip


@numba.njit(**_OPTIONS)
def _push(dq, f, velocity, WF, WO, c, r, impulse):
    """Change the speeds by an impulse along row ``r`` of contact ``c``."""
    for i in range(DRIVEN):
        dq[f, i] += WF[c, r, i] * impulse
    for k in range(6):
        velocity[k] += WO[c, r, k] * impulse


@numba.njit(**_OPTIONS)
def _weigh(axes, points, along, mass, centre, gravity, torque):
    """Add the torques ``(3,)`` of the links' weight: gravity times the level lever of each centre of mass."""
    for link in range(3):
        x = points[link, 0] + centre[link] * along[link, 0]
        y = points[link, 1] + centre[link] * along[link, 1]
        pull = -mass[link] * gravity
        torque[0] += pull * (axes[0, 0] * (y - points[0, 1]) - axes[0, 1] * (x - points[0, 0]))
        torque[1] += pull * (axes[1, 0] * (y - points[0, 1]) - axes[1, 1] * (x - points[0, 0]))
        for joint in range(1, link + 1):
            torque[2] += pull * (axes[1, 0] * (y - points[joint, 1]) - axes[1, 1] * (x - points[joint, 0]))


@numba.njit(**_INSIDE)
def _move_freely(
    dt, keep, hand, parameters, damping, feedforward, offset, target, filtered, q, dq, velocity, place, work
):
    """The command filter, and all speeds after a step without contacts; ``R``, ``axes``, ``points``, ``along`` too."""
    base, lengths, masses, centres, _, _, _, inverse_mass, _, _ = hand
    R, torque, axes, points, along, _, _, _, _, _, _, _, _, _, _, _, _, _, frame = work
    for f in range(FINGERS):
        for i in range(DRIVEN):
            filtered[f, i] = target[f, i] + keep * (filtered[f, i] - target[f, i])
            frame[f, i] = filtered[f, i] - offset[f, i]
    _drive(frame, q, parameters, torque, feedforward, damping, dq)
    for f in range(FINGERS):
        pose_finger(base[f], lengths, q[f, 0], q[f, 1], q[f, 2], axes[f], points[f], along[f])
        _weigh(axes[f], points[f], along[f], masses, centres, parameters[GRAVITY], torque[f])
        for i in range(DRIVEN):
            for j in range(DRIVEN):
                dq[f, i] += dt * inverse_mass[f, i, j] * torque[f, j]
    calm, mass = parameters[KEEP], parameters[MASS]
    for k in range(3):
        push = parameters[FORCE + k] + parameters[SUPPORT] * (parameters[PLACE + k] - place[k])
        spin = 0.0
        for m in range(3):  # R I^-1 R^T torque
            local = 0.0
            for n in range(3):
                local += R[n, m] * parameters[TORQUE + n]
            spin += R[k, m] * local / parameters[MOMENTS + m]
        velocity[k] = calm * (velocity[k] + dt * push / mass)
        velocity[3 + k] = calm * (velocity[3 + k] + dt * spin)
    velocity[2] -= calm * dt * parameters[GRAVITY]


@numba.njit(**_INSIDE)
def _touch(c, f, b, gap, dt, hand, parameters, dq, velocity, place, memory, work):
    """Contact ``c`` of ball ``b`` of finger ``f``, whose normal (object's frame) is in ``work``: all of its rows.

    Rows: along the normal, along two tangents, and turning about the normal.
    """
    _, _, _, _, ball_link, _, ball_radius, inverse_mass, _, _ = hand
    R, _, axes, points, _, ball, normal, D, JO, JF, WF, WO, K, B, L, C, _, _, frame = work
    distal = ball_link[b] == 2
    C[c, 0], C[c, 1] = f, b
    B[c] = -gap / dt if gap > 0.0 else -ERP * gap / dt
    for k in range(3):
        D[c, 0, k] = R[k, 0] * normal[0] + R[k, 1] * normal[1] + R[k, 2] * normal[2]
    _tangents(D[c, 0], D[c, 1], D[c, 2])
    for k in range(3):
        frame[0, k] = ball[f, b, k] - ball_radius[b] * D[c, 0, k]  # on the finger
        frame[1, k] = frame[0, k] - place[k]
    for r in range(3):
        _row(axes[f], points[f], frame[0], distal, D[c, r], JF[c, r])
        for k in range(3):
            JO[c, r, k] = -D[c, r, k]
        JO[c, r, 3] = frame[1, 2] * D[c, r, 1] - frame[1, 1] * D[c, r, 2]
        JO[c, r, 4] = frame[1, 0] * D[c, r, 2] - frame[1, 2] * D[c, r, 0]
        JO[c, r, 5] = frame[1, 1] * D[c, r, 0] - frame[1, 0] * D[c, r, 1]
    abduction, flexion = 0.0, 0.0
    for k in range(3):
        JO[c, 3, k], JO[c, 3, 3 + k] = 0.0, -D[c, 0, k]
        abduction += axes[f, 0, k] * D[c, 0, k]
        flexion += axes[f, 1, k] * D[c, 0, k]
    JF[c, 3, 0], JF[c, 3, 1], JF[c, 3, 2] = abduction, flexion, flexion * (2.0 if distal else 1.0)
    kept = memory[f, b]  # begin with what held it a step ago
    L[c, 3] = kept[3]
    for r in range(3):
        L[c, r] = kept[0] * D[c, r, 0] + kept[1] * D[c, r, 1] + kept[2] * D[c, r, 2]
    for r in range(4):
        k_inverse = _through(inverse_mass[f], JF[c, r], WF[c, r])
        for m in range(3):
            turning = R[0, m] * JO[c, r, 3] + R[1, m] * JO[c, r, 4] + R[2, m] * JO[c, r, 5]
            frame[2, m] = turning / parameters[MOMENTS + m]
        for k in range(3):
            WO[c, r, k] = JO[c, r, k] / parameters[MASS]
            WO[c, r, 3 + k] = R[k, 0] * frame[2, 0] + R[k, 1] * frame[2, 1] + R[k, 2] * frame[2, 2]
        for k in range(6):
            k_inverse += WO[c, r, k] * JO[c, r, k]
        K[c, r] = 1.0 / k_inverse
        if L[c, 0] <= 0.0:  # it has come apart
            L[c, r] = 0.0
        _push(dq, f, velocity, WF, WO, c, r, L[c, r])


@numba.njit(**_OPTIONS)
def _through(inverse_mass, row, out):
    """``out = M^-1 row`` of a finger; returns ``row M^-1 row``."""
    along = 0.0
    for i in range(DRIVEN):
        out[i] = 0.0
        for j in range(DRIVEN):
            out[i] += inverse_mass[i, j] * row[j]
        along += out[i] * row[i]
    return along


@numba.njit(**_INSIDE)
def _find_contacts(dt, hand, grid, origin, spacing, parameters, dq, velocity, place, memory, work):
    """All balls at the object or about to be; their number and the deepest penetration in m."""
    _, _, _, _, ball_link, ball_at, ball_radius, _, _, _ = hand
    R, _, _, points, along, ball, normal, _, _, _, _, _, _, _, _, _, _, _, frame = work
    count, deepest = 0, 0.0
    for f in range(FINGERS):
        for b in range(BALLS):
            link = ball_link[b]
            for k in range(3):
                ball[f, b, k] = points[f, link, k] + ball_at[b] * along[f, link, k]
            x, y, z = ball[f, b, 0] - place[0], ball[f, b, 1] - place[1], ball[f, b, 2] - place[2]
            for k in range(3):
                frame[0, k] = R[0, k] * x + R[1, k] * y + R[2, k] * z
            distance = lookup(grid, origin, spacing, frame[0, 0], frame[0, 1], frame[0, 2], normal)
            gap = distance - ball_radius[b]
            if gap > REACH:
                for k in range(4):
                    memory[f, b, k] = 0.0
                continue
            deepest = min(deepest, gap)
            _touch(count, f, b, gap, dt, hand, parameters, dq, velocity, place, memory, work)
            count += 1
    return count, deepest


@numba.njit(**_INSIDE)
def _find_pairs(dt, hand, work):
    """Fingers that touch each other: the nearest balls of two tips, without friction. Returns their number."""
    _, _, _, _, _, _, ball_radius, inverse_mass, _, _ = hand
    _, _, axes, points, _, ball, normal, _, _, _, _, _, _, _, _, _, S, JP, frame = work
    pairs = 0
    for f in range(FINGERS):
        for g in range(f + 1, FINGERS):
            nearest, left, right = 1.0, 0, 0
            for a in range(TIP_BALLS):
                for b in range(TIP_BALLS):
                    d = 0.0
                    for k in range(3):
                        d += (ball[f, a, k] - ball[g, b, k]) ** 2
                    if d < nearest:
                        nearest, left, right = d, a, b
            gap = math.sqrt(nearest) - 2.0 * ball_radius[0]
            if gap > REACH:
                continue
            for k in range(3):
                normal[k] = (ball[f, left, k] - ball[g, right, k]) / math.sqrt(nearest)
                frame[0, k] = 0.5 * (ball[f, left, k] + ball[g, right, k])
            _row(axes[f], points[f], frame[0], True, normal, JP[pairs, 0])
            _row(axes[g], points[g], frame[0], True, normal, JP[pairs, 1])
            k_inverse = _through(inverse_mass[f], JP[pairs, 0], JP[pairs, 2])
            k_inverse += _through(inverse_mass[g], JP[pairs, 1], JP[pairs, 3])
            S[pairs, 0], S[pairs, 1], S[pairs, 2] = f, g, 1.0 / k_inverse
            S[pairs, 3], S[pairs, 4] = (-gap / dt if gap > 0.0 else -ERP * gap / dt), 0.0
            pairs += 1
    return pairs


@numba.njit(**_INSIDE)
def _solve(count, pairs, dt, iterations, inverse_mass, parameters, stick, dq, velocity, memory, work):
    """Projected Gauss-Seidel over joint friction, fingers at each other, and contacts."""
    _, _, _, _, _, _, _, D, JO, JF, WF, WO, K, B, L, C, S, JP, rubbed = work
    rubbed[:] = 0.0  # impulses of the joints' friction
    for _ in range(iterations):
        for f in range(FINGERS):
            for i in range(DRIVEN):
                limit = stick[f, i] * dt
                before = rubbed[f, i]
                rubbed[f, i] = min(max(before - dq[f, i] / inverse_mass[f, i, i], -limit), limit)
                for j in range(DRIVEN):
                    dq[f, j] += inverse_mass[f, j, i] * (rubbed[f, i] - before)
        for p in range(pairs):
            f, g = int(S[p, 0]), int(S[p, 1])
            speed = 0.0
            for i in range(DRIVEN):
                speed += JP[p, 0, i] * dq[f, i] - JP[p, 1, i] * dq[g, i]
            before = S[p, 4]
            S[p, 4] = max(before + (S[p, 3] - speed) * S[p, 2], 0.0)
            for i in range(DRIVEN):
                dq[f, i] += JP[p, 2, i] * (S[p, 4] - before)
                dq[g, i] -= JP[p, 3, i] * (S[p, 4] - before)
        largest = 0.0
        for c in range(count):
            f, tip = C[c, 0], C[c, 1] < TIP_BALLS
            before = L[c, 0]
            after = max(before + (B[c] - _speed(dq, f, velocity, JF, JO, c, 0)) * K[c, 0], 0.0)
            if after == 0.0 and before == 0.0:
                continue  # apart, and so without friction
            L[c, 0] = after
            _push(dq, f, velocity, WF, WO, c, 0, after - before)
            largest = max(largest, abs(after - before) / K[c, 0])
            # friction: both tangents at once, brought back onto the cone
            bound = parameters[TIP_FRICTION if tip else LINK_FRICTION] * after
            one = L[c, 1] - _speed(dq, f, velocity, JF, JO, c, 1) * K[c, 1]
            two = L[c, 2] - _speed(dq, f, velocity, JF, JO, c, 2) * K[c, 2]
            size = one * one + two * two
            if size > bound * bound:
                shrink = bound / math.sqrt(size)
                one *= shrink
                two *= shrink
            largest = max(largest, max(abs(one - L[c, 1]) / K[c, 1], abs(two - L[c, 2]) / K[c, 2]))
            _push(dq, f, velocity, WF, WO, c, 1, one - L[c, 1])
            _push(dq, f, velocity, WF, WO, c, 2, two - L[c, 2])
            L[c, 1], L[c, 2] = one, two
            if tip:
                bound = parameters[SPIN_FRICTION] * after
                before = L[c, 3]
                turned = before - _speed(dq, f, velocity, JF, JO, c, 3) * K[c, 3]
                L[c, 3] = min(max(turned, -bound), bound)
                _push(dq, f, velocity, WF, WO, c, 3, L[c, 3] - before)
        if largest < RESIDUAL:
            break
    for c in range(count):
        kept = memory[C[c, 0], C[c, 1]]
        for k in range(3):
            kept[k] = L[c, 0] * D[c, 0, k] + L[c, 1] * D[c, 1, k] + L[c, 2] * D[c, 2, k]
        kept[3] = L[c, 3]


@numba.njit(**_INSIDE)
def _advance(
    dt, iterations, hand, grid, origin, spacing, parameters, damping, feedforward, stick, offset,
    target, filtered, q, dq, place, quaternion, velocity, memory, work, keep,
):  # fmt: skip
    """One physics step of one environment, in place; returns the deepest penetration in m."""
    _, _, _, _, _, _, _, inverse_mass, lower, upper = hand
    _rotation(quaternion, work[0])
    _move_freely(
        dt,
        keep,
        hand,
        parameters,
        damping,
        feedforward,
        offset,
        target,
        filtered,
        q,
        dq,
        velocity,
        place,
        work,
    )
    count, deepest = _find_contacts(
        dt, hand, grid, origin, spacing, parameters, dq, velocity, place, memory, work
    )
    pairs = _find_pairs(dt, hand, work)
    _solve(count, pairs, dt, iterations, inverse_mass, parameters, stick, dq, velocity, memory, work)
    for f in range(FINGERS):
        for i in range(DRIVEN):
            q[f, i] += dt * dq[f, i]
            if q[f, i] < lower[f, i]:
                q[f, i], dq[f, i] = lower[f, i], max(dq[f, i], 0.0)
            elif q[f, i] > upper[f, i]:
                q[f, i], dq[f, i] = upper[f, i], min(dq[f, i], 0.0)
    for k in range(3):
        place[k] += dt * velocity[k]
    _turn(quaternion, velocity, dt)
    return deepest


@numba.njit(**_OPTIONS)
def control_step(
    first, last, active, dt, per_sample, iterations, keep, hand, grids, origins, spacings, variant,
    parameters, damping, feedforward, stick, offset, noise, target, filtered, q, dq, place, quaternion,
    velocity, memory, z, deepest,
):  # fmt: skip
    """0.1 s of the environments ``first`` to ``last`` that are ``active``; measurements go to ``z (E, 6, 2, 4, 3)``."""
    work = (
        np.empty((3, 3)), np.empty((4, 3)), np.empty((4, 2, 3)), np.empty((4, 3, 3)), np.empty((4, 3, 3)),
        np.empty((4, BALLS, 3)), np.empty(3), np.empty((CONTACTS, 3, 3)), np.empty((CONTACTS, 4, 6)),
        np.empty((CONTACTS, 4, 3)), np.empty((CONTACTS, 4, 3)), np.empty((CONTACTS, 4, 6)), np.empty((CONTACTS, 4)),
        np.empty(CONTACTS), np.empty((CONTACTS, 4)), np.empty((CONTACTS, 2), np.int64), np.empty((PAIRS, 5)),
        np.empty((PAIRS, 4, 3)), np.empty((4, 3)),
    )  # fmt: skip
    for e in range(first, last):
        if not active[e]:
            continue
        deepest[e] = 0.0
        v = variant[e]
        for sample in range(SAMPLES):
            for _ in range(per_sample):
                gap = _advance(
                    dt, iterations, hand, grids[v], origins[v], spacings[v], parameters[e], damping[e], feedforward[e],
                    stick[e], offset[e], target[e], filtered[e], q[e], dq[e], place[e], quaternion[e], velocity[e],
                    memory[e], work, keep,
                )  # fmt: skip
                deepest[e] = min(deepest[e], gap)
            measure(q[e], filtered[e], offset[e], parameters[e], noise[e, sample], z[e, sample])


@numba.njit(**_OPTIONS)
def measure(q, filtered, offset, parameters, noise, z):
    """Motor-side angles and control errors ``z (2, 4, 3)`` that the robot would measure."""
    limit = parameters[LIMIT]
    for f in range(FINGERS):
        for i in range(DRIVEN):
            error = min(max(filtered[f, i] - offset[f, i] - q[f, i], -limit), limit)
            angle = q[f, i] + parameters[GIVE] * error + offset[f, i] + noise[f, i]
            z[0, f, i] = angle
            z[1, f, i] = filtered[f, i] - angle
