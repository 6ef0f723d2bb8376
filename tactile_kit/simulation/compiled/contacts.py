"""Contacts of the compiled physics: which spheres touch the object or another finger, and the rows to solve for them.

Speeds are scaled so that every mass is 1: a finger's by a factor of its inverse mass matrix, the object's by the roots
of mass and moments (turning in its own frame). Then the row that measures a speed is the row that an impulse pushes
along, which halves what the solver has to read.
"""

from __future__ import annotations

import numba

from tactile_kit.simulation.compiled.lanes import (
    LANES,
    any_of,
    blend,
    column,
    load,
    root,
    size,
    splat,
    store,
    where,
    whole,
)
from tactile_kit.simulation.compiled.rows import BALLS, DRIVEN, FINGERS, ROWS, TIP_BALLS, at
from tactile_kit.simulation.compiled.space import (
    INSIDE,
    chosen,
    cross,
    dot,
    inwards,
    load3,
    minus,
    outwards,
    plus,
    store3,
    times,
)

NODES = 32  # of a grid along each axis
REACH = 0.004  # m: nearer than that, a sphere is a contact to be
ERP = 0.2  # share of a penetration that a physics step makes good, Bullet's default
PAIRS = 6  # of fingers, which may touch each other at their tips

# The scratch: the table's rows of LANES environments, then these.
TURN = ROWS  # the object's rotation (9)
AXES = TURN + 9  # of abduction and flexion, by finger (4, 2, 3)
POINTS = AXES + FINGERS * 6  # origin, third and fourth joint, by finger (4, 3, 3)
ALONG = POINTS + FINGERS * 9  # directions of the links, by finger (4, 3, 3)
BALL = ALONG + FINGERS * 9  # the spheres' centres (4, 5, 3)
GAP = BALL + FINGERS * BALLS * 3  # (4, 5)
RANK = GAP + FINGERS * BALLS  # a sphere's number among its finger's contacts, -1: it has none (4, 5)
NORMAL = RANK + FINGERS * BALLS  # of the object, in its frame, of any length (4, 5, 3)
FINGER = NORMAL + FINGERS * BALLS * 3  # scaled speeds of the joints (4, 3)
OBJECT = FINGER + FINGERS * DRIVEN  # and of the object (6)
RUBBED = OBJECT + 6  # impulses of the joints' friction (4, 3)
CELL = RUBBED + FINGERS * DRIVEN  # of the grid, and the place in it (4)
NODE = CELL + 4  # distance and direction, by lane (LANES, 4)
SLOTS = NODE + 4  # contacts, by finger and number (4, 5, SLOT)
# of a contact: rows along normal and tangents, each finger (3), object (6), 1/K (1), K (1); the row of turning about
# the normal; then
ROW, ALIKE, OPPOSED = 11, 9, 10  # K: speed that a unit impulse brings; its inverse comes first
SPIN, SPIN_ALIKE = 3 * ROW, 3 * ROW + 6
BIAS = SPIN_ALIKE + 1  # m/s that the contact is to part with
GRIP, TWIST = BIAS + 1, BIAS + 2  # friction coefficients
SHARED = BIAS + 3  # speeds along other rows: of normal pushes 3, of tangential ones about the normal 2
IMPULSE = SHARED + 5  # normal, tangents, about the normal (4)
FRAME = IMPULSE + 4  # normal and tangents in the world (9)
SLOT = FRAME + 9
COUPLES = SLOTS + FINGERS * BALLS * SLOT  # fingers at each other (6, COUPLE)
COUPLE = 9  # rows of both fingers (3, 3), 1/K, bias, impulse
SCRATCH = COUPLES + PAIRS * COUPLE


@numba.njit(**INSIDE)
def look_up(s, hand, grids, first, x, y, z):
    """Distance (m) from the object's surface of a point in its frame, 1 m off the grid; direction, of any length."""
    origin, cells = load3(s, at.origin), load3(s, at.cells)
    gx, gy, gz = (x - origin[0]) * cells[0], (y - origin[1]) * cells[1], (z - origin[2]) * cells[2]
    top = NODES - 1.0
    within = (gx >= 0.0) & (gx < top) & (gy >= 0.0) & (gy < top) & (gz >= 0.0) & (gz < top)
    gx, gy, gz = where(within, gx, 0.0), where(within, gy, 0.0), where(within, gz, 0.0)
    i, j, k = whole(gx), whole(gy), whole(gz)
    store(s, CELL, (i * NODES + j) * NODES + k)
    store(s, CELL + 1, gx - i)
    store(s, CELL + 2, gy - j)
    store(s, CELL + 3, gz - k)
    for lane in range(LANES):
        here = CELL * LANES + lane
        node = 4 * (first[lane] + int(s[here]))
        blend(
            grids,
            node,
            4 * NODES * NODES,
            4 * NODES,
            s[here + LANES],
            s[here + 2 * LANES],
            s[here + 3 * LANES],
            s,
            NODE * LANES + 4 * lane,
        )
    distance = where(within, column(s, NODE, 0), 1.0)
    return distance, (column(s, NODE, 1), column(s, NODE, 2), column(s, NODE, 3))


@numba.njit(**INSIDE)
def find_contacts(s, hand, grids, first, counts, dt):
    """All spheres at the object or about to be; ``counts (4,)`` gets the most that a lane has, by finger."""
    place = load3(s, at.place)
    deepest = load(s, at.deepest)
    for f in range(FINGERS):
        number = splat(0.0)
        for b in range(BALLS):
            c, link = f * BALLS + b, 3 * (3 * f + hand.ball_link[b])
            ball = plus(load3(s, POINTS + link), times(load3(s, ALONG + link), hand.ball_at[b]))
            store3(s, BALL + 3 * c, ball)
            x, y, z = inwards(s, TURN, minus(ball, place))
            distance, normal = look_up(s, hand, grids, first, x, y, z)
            gap = distance - hand.ball_radius[b]
            touching = gap <= REACH
            deepest = where(touching & (gap < deepest), gap, deepest)
            store(s, GAP + c, gap)
            store3(s, NORMAL + 3 * c, normal)
            store(s, RANK + c, where(touching, number, -1.0))
            number = where(touching, number + 1.0, number)
        count = 0
        while any_of(number > count):
            _fill_slot(s, hand, f, count, dt)
            count += 1
        counts[f] = count
    store(s, at.deepest, deepest)


@numba.njit(**INSIDE)
def _levers(s, hand, f, point, distal):
    """Velocities ``(3, 3)`` of a point of a finger's middle or distal link for unit scaled speeds of its joints."""
    abduction, flexion = load3(s, AXES + 6 * f), load3(s, AXES + 6 * f + 3)
    one = minus(point, load3(s, POINTS + 9 * f))
    two = minus(point, load3(s, POINTS + 9 * f + 3))
    three = minus(point, load3(s, POINTS + 9 * f + 6))  # the tendon turns the last joint as much
    two = chosen(distal, plus(two, three), two)
    second, third = cross(flexion, one), cross(flexion, two)
    spread = hand.spread
    return (
        times(cross(abduction, one), spread[f, 0, 0]),
        plus(times(second, spread[f, 1, 1]), times(third, spread[f, 2, 1])),
        times(third, spread[f, 2, 2]),
    )


@numba.njit(**INSIDE)
def _fill_slot(s, hand, f, number, dt):
    """Contact ``number`` of finger ``f``: a sphere that may be another one in every lane, or none."""
    c = SLOTS + (f * BALLS + number) * SLOT
    ball, normal = load3(s, BALL + 3 * f * BALLS), (splat(0.0), splat(0.0), splat(1.0))
    gap, kept, twist = splat(0.0), (splat(0.0), splat(0.0), splat(0.0)), splat(0.0)
    radius, tip = splat(hand.ball_radius[0]), splat(0.0)
    for b in range(BALLS):
        o = f * BALLS + b
        here = load(s, RANK + o) == number
        gap = where(here, load(s, GAP + o), gap)
        radius = where(here, hand.ball_radius[b], radius)
        tip = where(here, 1.0 if b < TIP_BALLS else -1.0, tip)
        one, two, three = load3(s, BALL + 3 * o), load3(s, NORMAL + 3 * o), load3(s, at.memory + 4 * o)
        ball, normal, kept = chosen(here, one, ball), chosen(here, two, normal), chosen(here, three, kept)
        twist = where(here, load(s, at.memory + 4 * o + 3), twist)
    touching, distal = size(tip) > 0.5, tip > 0.5
    store(s, c + BIAS, where(gap > 0.0, -gap, -ERP * gap) * (1.0 / dt))
    store(s, c + GRIP, where(distal, load(s, at.tip_friction), load(s, at.link_friction)))
    store(s, c + TWIST, where(distal, load(s, at.spin_friction), 0.0))
    inner = times(normal, 1.0 / (root(dot(normal, normal)) + 1e-12))
    n = outwards(s, TURN, inner)
    slanted = size(n[0]) < 0.7
    norm = 1.0 / root(n[1] * n[1] + where(slanted, n[2] * n[2], n[0] * n[0]))
    t = (
        where(slanted, 0.0, -n[1] * norm),
        where(slanted, -n[2] * norm, n[0] * norm),
        where(slanted, n[1] * norm, 0.0),
    )
    point = minus(ball, times(n, radius))
    arm = inwards(s, TURN, minus(point, load3(s, at.place)))
    levers = _levers(s, hand, f, point, distal)
    lightness = 1.0 / root(load(s, at.mass))
    moments = load3(s, at.moments)
    ease = 1.0 / root(moments[0]), 1.0 / root(moments[1]), 1.0 / root(moments[2])
    u, v = load3(s, OBJECT), load3(s, OBJECT + 3)
    w = load3(s, FINGER + 3 * f)
    pressed = touching & (dot(kept, n) > 0.0)  # else it has come apart
    for r in range(3):
        d = n
        if r == 1:
            d = t
        elif r == 2:
            d = cross(n, t)
        own = inwards(s, TURN, d)
        finger = dot(d, levers[0]), dot(d, levers[1]), dot(d, levers[2])
        level = times(d, -lightness)
        turning = cross(own, arm)
        turning = turning[0] * ease[0], turning[1] * ease[1], turning[2] * ease[2]
        opposed = dot(finger, finger) + dot(level, level) + dot(turning, turning)
        row = c + r * ROW
        store3(s, row, finger)
        store3(s, row + 3, level)
        store3(s, row + 6, turning)
        store(s, row + ALIKE, where(touching, 1.0 / opposed, 0.0))
        store(s, row + OPPOSED, opposed)
        impulse = where(pressed, dot(kept, d), 0.0)
        store(s, c + IMPULSE + r, impulse)
        store3(s, c + FRAME + 3 * r, d)
        w = chosen(pressed, plus(w, times(finger, impulse)), w)
        u = chosen(pressed, plus(u, times(level, impulse)), u)
        v = chosen(pressed, plus(v, times(turning, impulse)), v)
    flexion = dot(load3(s, AXES + 6 * f + 3), n)
    last = where(distal, 2.0 * flexion, flexion)
    spread = hand.spread
    finger = (
        dot(load3(s, AXES + 6 * f), n) * spread[f, 0, 0],
        flexion * spread[f, 1, 1] + last * spread[f, 2, 1],
        last * spread[f, 2, 2],
    )
    turning = -inner[0] * ease[0], -inner[1] * ease[1], -inner[2] * ease[2]
    store3(s, c + SPIN, finger)
    store3(s, c + SPIN + 3, turning)
    store(s, c + SPIN_ALIKE, 1.0 / (dot(finger, finger) + dot(turning, turning)))
    twist = where(pressed, twist, 0.0)
    store(s, c + IMPULSE + 3, twist)
    store3(s, FINGER + 3 * f, chosen(pressed, plus(w, times(finger, twist)), w))
    store3(s, OBJECT, u)
    store3(s, OBJECT + 3, chosen(pressed, plus(v, times(turning, twist)), v))
    one, two = c + ROW, c + 2 * ROW
    store(s, c + SHARED, dot(load3(s, c), load3(s, one)) + dot(load3(s, c + 6), load3(s, one + 6)))
    store(s, c + SHARED + 1, dot(load3(s, c), load3(s, two)) + dot(load3(s, c + 6), load3(s, two + 6)))
    store(s, c + SHARED + 2, dot(load3(s, c), finger) + dot(load3(s, c + 6), turning))
    store(s, c + SHARED + 3, dot(load3(s, one), finger) + dot(load3(s, one + 6), turning))
    store(s, c + SHARED + 4, dot(load3(s, two), finger) + dot(load3(s, two + 6), turning))


@numba.njit(**INSIDE)
def find_pairs(s, hand, pairs, dt):
    """Fingers that touch each other: the nearest spheres of two tips, without friction; ``pairs (6,)`` says where."""
    p = 0
    for f in range(FINGERS):
        for g in range(f + 1, FINGERS):
            nearest = splat(1.0)
            left, right = load3(s, BALL + 3 * BALLS * f), load3(s, BALL + 3 * BALLS * g)
            for a in range(TIP_BALLS):
                one = load3(s, BALL + 3 * (BALLS * f + a))
                for b in range(TIP_BALLS):
                    two = load3(s, BALL + 3 * (BALLS * g + b))
                    apart = minus(one, two)
                    distance = dot(apart, apart)
                    nearer = distance < nearest
                    nearest = where(nearer, distance, nearest)
                    left, right = chosen(nearer, one, left), chosen(nearer, two, right)
            distance = root(nearest)
            gap = distance - 2.0 * hand.ball_radius[0]
            touching = gap <= REACH
            pairs[p] = any_of(touching)
            if pairs[p]:
                row = COUPLES + p * COUPLE
                d = times(minus(left, right), 1.0 / distance)
                middle = times(plus(left, right), 0.5)
                distal = nearest == nearest
                levers = _levers(s, hand, f, middle, distal)
                one = dot(d, levers[0]), dot(d, levers[1]), dot(d, levers[2])
                levers = _levers(s, hand, g, middle, distal)
                two = dot(d, levers[0]), dot(d, levers[1]), dot(d, levers[2])
                store3(s, row, one)
                store3(s, row + 3, two)
                store(s, row + 6, where(touching, 1.0 / (dot(one, one) + dot(two, two)), 0.0))
                store(s, row + 7, where(gap > 0.0, -gap, -ERP * gap) * (1.0 / dt))
                store(s, row + 8, 0.0)
            p += 1
