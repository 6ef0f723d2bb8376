"""The compiled physics: a control step of many environments, ``LANES`` at a time, without Bullet and without Python.

It solves the problem Bullet's multibody solver solves, for this hand and one object only: velocities after the free
motion are corrected by projected Gauss-Seidel over contact, friction and joint friction rows, then integrated. A
finger has three coordinates (the tendon makes q4 a part of q3) and the mass matrix of the mean grasp; its links touch
the object as rows of spheres; the object is a grid of distances. docs/compiled.md compares it with Bullet;
tests/simulation/physics_twin.py says the same plainly, in double precision, one environment at a time.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numba

from tactile_kit.simulation.compiled.contacts import (
    ALONG,
    AXES,
    FINGER,
    OBJECT,
    POINTS,
    TURN,
    find_contacts,
    find_pairs,
)
from tactile_kit.simulation.compiled.lanes import LANES, load, root, splat, store, where
from tactile_kit.simulation.compiled.rows import DRIVEN, FINGERS, FIRST_WRITTEN, ROWS, SAMPLES, at
from tactile_kit.simulation.compiled.solver import remember, solve
from tactile_kit.simulation.compiled.space import (
    INSIDE,
    cross,
    dot,
    inwards,
    load3,
    outwards,
    plus,
    store3,
    times,
    wave,
)

QUARTER = 1.57  # rad of half a turn about the speed's axis, at most, in a physics step


@numba.njit(**INSIDE)
def _clipped(a, limit):
    return where(a < -limit, -limit, where(a > limit, limit, a))


@numba.njit(**INSIDE)
def _rotation(s):
    x, y, z, w = (
        load(s, at.quaternion),
        load(s, at.quaternion + 1),
        load(s, at.quaternion + 2),
        load(s, at.quaternion + 3),
    )
    store3(s, TURN, (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)))
    store3(s, TURN + 3, (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)))
    store3(s, TURN + 6, (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)))


@numba.njit(**INSIDE)
def _pose_finger(s, hand, f):
    """Forward kinematics: axes of abduction and flexion, origin, third and fourth joint, and the links' directions."""
    base = hand.bases
    s1, c1 = wave(load(s, at.q + 3 * f))
    s2, c2 = wave(load(s, at.q + 3 * f + 1))
    s3, c3 = wave(load(s, at.q + 3 * f + 2))
    x, y = (base[f, 0, 0], base[f, 0, 1], base[f, 0, 2]), (base[f, 1, 0], base[f, 1, 1], base[f, 1, 2])
    z = splat(base[f, 2, 0]), splat(base[f, 2, 1]), splat(base[f, 2, 2])
    level = c1 * x[0] + s1 * y[0], c1 * x[1] + s1 * y[1], c1 * x[2] + s1 * y[2]
    store3(s, AXES + 6 * f, z)
    store3(s, AXES + 6 * f + 3, (s1 * x[0] - c1 * y[0], s1 * x[1] - c1 * y[1], s1 * x[2] - c1 * y[2]))
    point = splat(base[f, 3, 0]), splat(base[f, 3, 1]), splat(base[f, 3, 2])
    sine, cosine = s2, c2
    for link in range(3):
        along = plus(times(level, cosine), times(z, sine))
        store3(s, POINTS + 9 * f + 3 * link, point)
        store3(s, ALONG + 9 * f + 3 * link, along)
        if link < 2:
            point = plus(point, times(along, hand.lengths[link]))
        sine, cosine = sine * c3 + cosine * s3, cosine * c3 - sine * s3


@numba.njit(**INSIDE)
def _weight(s, hand, f):
    """Torques ``(3,)`` of the links' weight: gravity times the level lever of each centre of mass."""
    axes = AXES + 6 * f
    ax, ay, bx, by = load(s, axes), load(s, axes + 1), load(s, axes + 3), load(s, axes + 4)
    gravity = load(s, at.gravity)
    one, two, three = splat(0.0), splat(0.0), splat(0.0)
    origin = POINTS + 9 * f
    for link in range(3):
        x = load(s, origin + 3 * link) + hand.centres[link] * load(s, ALONG + 9 * f + 3 * link)
        y = load(s, origin + 3 * link + 1) + hand.centres[link] * load(s, ALONG + 9 * f + 3 * link + 1)
        pull = gravity * -hand.masses[link]
        dx, dy = x - load(s, origin), y - load(s, origin + 1)
        one = one + pull * (ax * dy - ay * dx)
        two = two + pull * (bx * dy - by * dx)
        for joint in range(1, link + 1):
            dx, dy = x - load(s, origin + 3 * joint), y - load(s, origin + 3 * joint + 1)
            three = three + pull * (bx * dy - by * dx)
    return one, two, three


@numba.njit(**INSIDE)
def _move_fingers(s, hand, dt, keep):
    """The command filter, the drives, the links' weight: scaled speeds of the joints after a step without contacts."""
    limit, stiffness = load(s, at.limit), load(s, at.stiffness)
    for f in range(FINGERS):
        _pose_finger(s, hand, f)
        weight = _weight(s, hand, f)
        speeds = load3(s, at.dq + 3 * f)
        torque = weight
        for i in range(DRIVEN):
            j = 3 * f + i
            target = load(s, at.target + j)
            filtered = target + keep * (load(s, at.filtered + j) - target)
            store(s, at.filtered + j, filtered)
            error = _clipped(filtered - load(s, at.offset + j) - load(s, at.q + j), limit)
            drive = (
                load(s, at.feedforward + j) + stiffness * error - dot(load3(s, at.damping + 3 * j), speeds)
            )
            if i == 0:
                torque = torque[0] + drive, torque[1], torque[2]
            elif i == 1:
                torque = torque[0], torque[1] + drive, torque[2]
            else:
                torque = torque[0], torque[1], torque[2] + drive
        spread, gathered = hand.spread, hand.gathered
        # u = S^-1 dq + dt S^T torque, where the inverse mass matrix is S S^T
        store(s, FINGER + 3 * f, gathered[f, 0, 0] * speeds[0] + (dt * spread[f, 0, 0]) * torque[0])
        store(
            s,
            FINGER + 3 * f + 1,
            gathered[f, 1, 1] * speeds[1]
            + (dt * spread[f, 1, 1]) * torque[1]
            + (dt * spread[f, 2, 1]) * torque[2],
        )
        store(
            s,
            FINGER + 3 * f + 2,
            gathered[f, 2, 1] * speeds[1]
            + gathered[f, 2, 2] * speeds[2]
            + (dt * spread[f, 2, 2]) * torque[2],
        )


@numba.njit(**INSIDE)
def _roots(s):
    """Roots of the object's mass and moments."""
    moments = load3(s, at.moments)
    return root(load(s, at.mass)), (root(moments[0]), root(moments[1]), root(moments[2]))


@numba.njit(**INSIDE)
def _move_object(s, dt):
    """Scaled speeds of the object after a step without contacts."""
    calm, (heaviness, sloth) = load(s, at.calm), _roots(s)
    speeds = plus(load3(s, at.velocity), times(load3(s, at.force), dt / load(s, at.mass)))
    speeds = speeds[0], speeds[1], speeds[2] - dt * load(s, at.gravity)
    store3(s, OBJECT, times(speeds, calm * heaviness))
    turning, twist = inwards(s, TURN, load3(s, at.velocity + 3)), inwards(s, TURN, load3(s, at.torque))
    store3(
        s,
        OBJECT + 3,
        (
            calm * (turning[0] * sloth[0] + dt * twist[0] / sloth[0]),
            calm * (turning[1] * sloth[1] + dt * twist[1] / sloth[1]),
            calm * (turning[2] * sloth[2] + dt * twist[2] / sloth[2]),
        ),
    )


@numba.njit(**INSIDE)
def _integrate(s, hand, dt):
    """Speeds from the scaled ones; poses a step later."""
    spread = hand.spread
    for f in range(FINGERS):
        w = load3(s, FINGER + 3 * f)
        for i in range(DRIVEN):
            j = 3 * f + i
            speed = spread[f, i, 0] * w[0] + spread[f, i, 1] * w[1] + spread[f, i, 2] * w[2]
            angle = load(s, at.q + j) + dt * speed
            low, high = hand.lower[f, i], hand.upper[f, i]
            below, above = angle < low, angle > high
            speed = where(below & (speed < 0.0), 0.0, where(above & (speed > 0.0), 0.0, speed))
            store(s, at.q + j, where(below, low, where(above, high, angle)))
            store(s, at.dq + j, speed)
    heaviness, sloth = _roots(s)
    velocity, u = times(load3(s, OBJECT), 1.0 / heaviness), load3(s, OBJECT + 3)
    spin = outwards(s, TURN, (u[0] / sloth[0], u[1] / sloth[1], u[2] / sloth[2]))
    store3(s, at.velocity, velocity)
    store3(s, at.velocity + 3, spin)
    store3(s, at.place, plus(load3(s, at.place), times(velocity, dt)))
    # the quaternion turned by spin * dt
    speed = root(dot(spin, spin))
    half = speed * (0.5 * dt)
    sine, w = wave(where(half > QUARTER, QUARTER, half))
    d = times(spin, where(half < 1e-6, 0.5 * dt, sine / speed))
    own, q = load3(s, at.quaternion), load(s, at.quaternion + 3)
    turned = plus(plus(times(own, w), times(d, q)), cross(d, own))
    last = w * q - dot(d, own)
    norm = 1.0 / root(dot(turned, turned) + last * last)
    store3(s, at.quaternion, times(turned, norm))
    store(s, at.quaternion + 3, last * norm)


@numba.njit(**INSIDE)
def _measure(s, sample):
    """Motor-side angles and control errors that the robot would measure."""
    limit, give = load(s, at.limit), load(s, at.give)
    joints = FINGERS * DRIVEN
    for j in range(joints):
        q, filtered, offset = load(s, at.q + j), load(s, at.filtered + j), load(s, at.offset + j)
        error = _clipped(filtered - offset - q, limit)
        angle = q + give * error + offset + load(s, at.noise + sample * joints + j)
        store(s, at.z + 2 * sample * joints + j, angle)
        store(s, at.z + (2 * sample + 1) * joints + j, filtered - angle)


@numba.njit(**INSIDE)
def _copy(table, block, s, first, inside):
    """Rows from ``first`` on of a block of environments, out of the table or into it."""
    blocks = len(table) // (ROWS * LANES)
    for row in range(first, ROWS):
        if inside:
            store(s, row, load(table, row * blocks + block))
        else:
            store(table, row * blocks + block, load(s, row))


def _compiled(version: str):
    """The entry, named on disk by ``version`` too: numba itself sees changes of this file only."""

    @numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=INSIDE["fastmath"])
    def control_step(first, last, dt, per_sample, iterations, keep, hand, grids, nodes, table, s, numbers):
        """0.1 s of the blocks ``first`` to ``last`` of ``LANES`` environments each, in place in ``table``.

        ``table (ROWS * P,)`` flat, ``nodes (P,)`` the first node of each environment's grid in ``grids (G * 4,)``;
        ``s (SCRATCH * LANES,)`` and ``numbers (FINGERS + PAIRS,)`` are room to work in.
        """
        version  # noqa: B018
        counts, pairs = numbers[:FINGERS], numbers[FINGERS:]
        for block in range(first, last):
            _copy(table, block, s, 0, True)
            store(s, at.deepest, 0.0)
            for sample in range(SAMPLES):
                for _ in range(per_sample):
                    _rotation(s)
                    _move_fingers(s, hand, dt, keep)
                    _move_object(s, dt)
                    find_contacts(s, hand, grids, nodes[block * LANES : (block + 1) * LANES], counts, dt)
                    find_pairs(s, hand, pairs, dt)
                    solve(s, hand, counts, pairs, iterations, dt)
                    remember(s, counts)
                    _integrate(s, hand, dt)
                _measure(s, sample)
            _copy(table, block, s, FIRST_WRITTEN, False)

    return control_step


PARTS = [Path(__file__).parent / f"{name}.py" for name in ("contacts", "lanes", "rows", "solver", "space")]
control_step = _compiled(hashlib.sha256(b"".join(part.read_bytes() for part in PARTS)).hexdigest())
