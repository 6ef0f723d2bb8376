"""Projected Gauss-Seidel of the compiled physics, over lanes: a lane that is done changes no more."""

from __future__ import annotations

import numba

from tactile_kit.simulation.compiled.contacts import (
    ALIKE,
    BIAS,
    COUPLE,
    COUPLES,
    FINGER,
    FRAME,
    GRIP,
    IMPULSE,
    OBJECT,
    OPPOSED,
    RANK,
    ROW,
    RUBBED,
    SHARED,
    SLOT,
    SLOTS,
    SPIN,
    SPIN_ALIKE,
    TWIST,
)
from tactile_kit.simulation.compiled.lanes import any_of, load, root, size, splat, store, where
from tactile_kit.simulation.compiled.rows import BALLS, DRIVEN, FINGERS, at
from tactile_kit.simulation.compiled.space import INSIDE, chosen, dot, load3, plus, store3, times

RESIDUAL = 1e-5  # m/s: no row is corrected by more, solved


@numba.njit(**INSIDE)
def _rub(s, hand, f, live, dt):
    """Dry friction of the joints of finger ``f``."""
    w = load3(s, FINGER + 3 * f)
    for i in range(DRIVEN):
        along = hand.spread[f, i, 0], hand.spread[f, i, 1], hand.spread[f, i, 2]
        limit = load(s, at.stick + 3 * f + i) * dt
        before = load(s, RUBBED + 3 * f + i)
        after = before - dot(w, along) * (1.0 / hand.inverse_mass[f, i, i])
        after = where(after < -limit, -limit, where(after > limit, limit, after))
        change = after - before
        w = chosen(live, plus(w, times(along, change)), w)
        store(s, RUBBED + 3 * f + i, where(live, after, before))
    store3(s, FINGER + 3 * f, w)


@numba.njit(**INSIDE)
def _part(s, f, g, row, live):
    """Fingers ``f`` and ``g`` at each other."""
    one, two = load3(s, row), load3(s, row + 3)
    w, x = load3(s, FINGER + 3 * f), load3(s, FINGER + 3 * g)
    before = load(s, row + 8)
    after = before + (load(s, row + 7) - (dot(one, w) - dot(two, x))) * load(s, row + 6)
    after = where(after < 0.0, 0.0, after)
    on = live & (after + before > 0.0)
    store(s, row + 8, where(on, after, before))
    store3(s, FINGER + 3 * f, chosen(on, plus(w, times(one, after - before)), w))
    store3(s, FINGER + 3 * g, chosen(on, plus(x, times(two, before - after)), x))


@numba.njit(**INSIDE)
def _speed(s, row, w, u, v):
    """Speed along ``row`` of a contact, of the finger against the object."""
    return dot(load3(s, row), w) + dot(load3(s, row + 3), u) + dot(load3(s, row + 6), v)


@numba.njit(**INSIDE)
def _given(s, row, speeds, pushes):
    """``speeds (3,)`` after impulses along the three rows of a contact, the first at ``row``."""
    one, two, three = load3(s, row), load3(s, row + ROW), load3(s, row + 2 * ROW)
    return plus(plus(plus(speeds, times(one, pushes[0])), times(two, pushes[1])), times(three, pushes[2]))


@numba.njit(**INSIDE)
def _contact(s, c, live, largest, w, u, v):
    """One contact: normal, both tangents at once and brought back onto the cone, turning about the normal.

    All of its speeds are read first, and what one impulse does to the other rows comes from their products: reading
    them anew after each push would take twice as long, all of it waiting.
    """
    impulse = c + IMPULSE
    normal, one, two, three = (
        load(s, impulse),
        load(s, impulse + 1),
        load(s, impulse + 2),
        load(s, impulse + 3),
    )
    after = normal + (load(s, c + BIAS) - _speed(s, c, w, u, v)) * load(s, c + ALIKE)
    after = where(after < 0.0, 0.0, after)
    on = live & (after + normal > 0.0)  # elsewhere apart, and so without friction
    if not any_of(on):
        return largest, w, u, v
    speed_one, speed_two = _speed(s, c + ROW, w, u, v), _speed(s, c + 2 * ROW, w, u, v)
    finger, turning = load3(s, c + SPIN), load3(s, c + SPIN + 3)
    speed_three = dot(finger, w) + dot(turning, v)
    push = after - normal
    store(s, impulse, where(on, after, normal))
    worst = size(push) * load(s, c + OPPOSED)

    bound = load(s, c + GRIP) * after
    first = one - (speed_one + load(s, c + SHARED) * push) * load(s, c + ROW + ALIKE)
    second = two - (speed_two + load(s, c + SHARED + 1) * push) * load(s, c + 2 * ROW + ALIKE)
    length = first * first + second * second
    shrink = where(length > bound * bound, bound / root(length), 1.0)
    first, second = first * shrink, second * shrink
    store(s, impulse + 1, where(on, first, one))
    store(s, impulse + 2, where(on, second, two))
    first, second = first - one, second - two
    error = size(first) * load(s, c + ROW + OPPOSED)
    worst = where(error > worst, error, worst)
    error = size(second) * load(s, c + 2 * ROW + OPPOSED)
    worst = where(error > worst, error, worst)

    bound = load(s, c + TWIST) * after
    speed_three = speed_three + load(s, c + SHARED + 2) * push
    speed_three = speed_three + load(s, c + SHARED + 3) * first + load(s, c + SHARED + 4) * second
    third = three - speed_three * load(s, c + SPIN_ALIKE)
    third = where(third < -bound, -bound, where(third > bound, bound, third))
    store(s, impulse + 3, where(on, third, three))
    third = third - three
    pushes = push, first, second
    w = chosen(on, plus(_given(s, c, w, pushes), times(finger, third)), w)
    u = chosen(on, _given(s, c + 3, u, pushes), u)
    v = chosen(on, plus(_given(s, c + 6, v, pushes), times(turning, third)), v)
    return where(on & (worst > largest), worst, largest), w, u, v


@numba.njit(**INSIDE)
def solve(s, hand, counts, pairs, iterations, dt):
    """Over joint friction, fingers at each other, and contacts, until no row of a lane is far off."""
    for row in range(RUBBED, RUBBED + FINGERS * DRIVEN):
        store(s, row, 0.0)
    nothing = splat(0.0)
    live = nothing == nothing
    u, v = load3(s, OBJECT), load3(s, OBJECT + 3)
    for _ in range(iterations):
        for f in range(FINGERS):
            _rub(s, hand, f, live, dt)
        p = 0
        for f in range(FINGERS):
            for g in range(f + 1, FINGERS):
                if pairs[p]:
                    _part(s, f, g, COUPLES + p * COUPLE, live)
                p += 1
        largest = nothing
        for f in range(FINGERS):
            w = load3(s, FINGER + 3 * f)
            for number in range(counts[f]):
                c = SLOTS + (f * BALLS + number) * SLOT
                largest, w, u, v = _contact(s, c, live, largest, w, u, v)
            store3(s, FINGER + 3 * f, w)
        live = live & (largest >= RESIDUAL)
        if not any_of(live):
            break
    store3(s, OBJECT, u)
    store3(s, OBJECT + 3, v)


@numba.njit(**INSIDE)
def remember(s, counts):
    """Keep the impulses of every sphere for the next physics step."""
    nothing = splat(0.0)
    for f in range(FINGERS):
        for b in range(BALLS):
            rank, kept, twist = load(s, RANK + f * BALLS + b), (nothing, nothing, nothing), nothing
            for number in range(counts[f]):
                c = SLOTS + (f * BALLS + number) * SLOT
                here = rank == number
                one, two, three = load(s, c + IMPULSE), load(s, c + IMPULSE + 1), load(s, c + IMPULSE + 2)
                frame = c + FRAME
                whole = plus(
                    plus(times(load3(s, frame), one), times(load3(s, frame + 3), two)),
                    times(load3(s, frame + 6), three),
                )
                kept = chosen(here, whole, kept)
                twist = where(here, load(s, c + IMPULSE + 3), twist)
            store3(s, at.memory + 4 * (f * BALLS + b), kept)
            store(s, at.memory + 4 * (f * BALLS + b) + 3, twist)
