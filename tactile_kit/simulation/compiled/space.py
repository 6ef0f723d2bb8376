"""Vectors in space, a lane an environment: triples of :mod:`~tactile_kit.simulation.compiled.lanes`' vectors."""

from __future__ import annotations

import numba

from tactile_kit.simulation.compiled.lanes import load, store, where

#: Of the kernels' parts: never compiled alone, so never stale on disk.
INSIDE = {
    "forceinline": True,
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},  # but not what assumes that everything is finite
}


@numba.njit(**INSIDE)
def load3(s, row):
    return load(s, row), load(s, row + 1), load(s, row + 2)


@numba.njit(**INSIDE)
def store3(s, row, a):
    store(s, row, a[0])
    store(s, row + 1, a[1])
    store(s, row + 2, a[2])


@numba.njit(**INSIDE)
def plus(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@numba.njit(**INSIDE)
def minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@numba.njit(**INSIDE)
def times(a, b):
    """``a`` times the number or vector ``b``."""
    return a[0] * b, a[1] * b, a[2] * b


@numba.njit(**INSIDE)
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(**INSIDE)
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(**INSIDE)
def chosen(condition, a, b):
    """``a`` in the lanes where ``condition`` holds, elsewhere ``b``, to the bit."""
    return where(condition, a[0], b[0]), where(condition, a[1], b[1]), where(condition, a[2], b[2])


@numba.njit(**INSIDE)
def outwards(s, row, a):
    """``R a`` for the rotation in the nine rows from ``row``."""
    return dot(load3(s, row), a), dot(load3(s, row + 3), a), dot(load3(s, row + 6), a)


@numba.njit(**INSIDE)
def inwards(s, row, a):
    """``R^T a``."""
    return plus(
        plus(times(load3(s, row), a[0]), times(load3(s, row + 3), a[1])), times(load3(s, row + 6), a[2])
    )


@numba.njit(**INSIDE)
def wave(x):
    """Sine and cosine to float32's precision for ``|x| < 2``, by series at the half angle."""
    h = x * 0.5
    w = h * h
    sine = h * (1.0 + w * (-1 / 6 + w * (1 / 120 + w * (-1 / 5040 + w * (1 / 362880)))))
    cosine = 1.0 + w * (-1 / 2 + w * (1 / 24 + w * (-1 / 720 + w * (1 / 40320 + w * (-1 / 3628800)))))
    return 2.0 * sine * cosine, 1.0 - 2.0 * sine * sine
