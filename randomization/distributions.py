"""Distributions as small frozen values.

A parameter is one number for all components, or a tuple with one number a component; a shorter tuple is
repeated until it fills the components, so three numbers describe the three joints of each of four fingers.
Values nest where that makes sense: ``Direction(Uniform(0.0, 0.04))`` is a random direction of random length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Protocol, runtime_checkable

import numpy as np

from randomization.errors import RandomizationError

Parameter = float | tuple[float, ...]


@runtime_checkable
class Distribution(Protocol):
    """What a term draws from. Equal values draw equal numbers from equal generators."""

    def sample(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        """Draw an array of ``shape`` (last axis: components); float64, or bool for ``Bernoulli``.

        The first rows of a larger draw are the rows of a smaller one.
        """
        ...

    def support(self) -> tuple[float, float]:
        """Smallest and largest value that can come out (for ``Normal`` six standard deviations)."""
        ...

    def describe(self) -> str:
        """Short text for tables, without unit."""
        ...


class _Checked:
    """Turns lists into tuples (hashable, equal by value) and refuses numbers that are not finite."""

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if isinstance(value, Distribution):
                continue
            if isinstance(value, (list, tuple, np.ndarray)):
                value = tuple(float(item) for item in value)
                if not value:
                    raise RandomizationError(f"{field.name} is empty: allowed are one or more numbers")
            else:
                value = float(value)
            if not np.all(np.isfinite(value)):
                raise RandomizationError(f"{field.name} = {value}: allowed are finite numbers")
            object.__setattr__(self, field.name, value)
        self._check()

    def _check(self) -> None: ...


@dataclass(frozen=True)
class Constant(_Checked):
    """Always ``value``."""

    value: Parameter

    def sample(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        return np.broadcast_to(_fill(self.value, shape), shape).copy()

    def support(self) -> tuple[float, float]:
        return float(np.min(self.value)), float(np.max(self.value))

    def describe(self) -> str:
        return _text(self.value)


@dataclass(frozen=True)
class Uniform(_Checked):
    """Uniform on [low, high)."""

    low: Parameter
    high: Parameter

    def _check(self) -> None:
        _ordered(self.low, self.high)

    def sample(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        low, high = _fill(self.low, shape), _fill(self.high, shape)
        return low + (high - low) * rng.random(shape)

    def support(self) -> tuple[float, float]:
        return float(np.min(self.low)), float(np.max(self.high))

    def describe(self) -> str:
        return f"U({_text(self.low)}, {_text(self.high)})"


@dataclass(frozen=True)
class LogUniform(_Checked):
    """exp of a uniform value between log(low) and log(high); 0 < low <= high."""

    low: Parameter
    high: Parameter

    def _check(self) -> None:
        if np.min(self.low) <= 0:
            raise RandomizationError(f"low = {self.low}: allowed are numbers > 0")
        _ordered(self.low, self.high)

    def sample(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        low, high = np.log(_fill(self.low, shape)), np.log(_fill(self.high, shape))
        return np.exp(low + (high - low) * rng.random(shape))

    def support(self) -> tuple[float, float]:
        return float(np.min(self.low)), float(np.max(self.high))

    def describe(self) -> str:
        return f"logU({_text(self.low)}, {_text(self.high)})"


@dataclass(frozen=True)
class Normal(_Checked):
    """Gaussian with ``mean`` and standard deviation ``std`` >= 0."""

    mean: Parameter
    std: Parameter

    def _check(self) -> None:
        if np.min(self.std) < 0:
            raise RandomizationError(f"std = {self.std}: allowed are numbers >= 0")

    def sample(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        return _fill(self.mean, shape) + _fill(self.std, shape) * rng.standard_normal(shape)

    def support(self) -> tuple[float, float]:
        reach = 6.0 * np.max(self.std)  # all but 2e-9 of the draws
        return float(np.min(self.mean) - reach), float(np.max(self.mean) + reach)

    def describe(self) -> str:
        return f"N({_text(self.mean)}, {_text(self.std)})"


@dataclass(frozen=True)
class Bernoulli(_Checked):
    """True with ``probability``."""

    probability: Parameter

    def _check(self) -> None:
        if np.min(self.probability) < 0 or np.max(self.probability) > 1:
            raise RandomizationError(f"probability = {self.probability}: allowed are numbers in [0, 1]")

    def sample(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        return rng.random(shape) < _fill(self.probability, shape)

    def support(self) -> tuple[float, float]:
        return 0.0, 1.0

    def describe(self) -> str:
        return f"p = {_text(self.probability)}"


@dataclass(frozen=True)
class Direction(_Checked):
    """A vector of length ``magnitude`` (>= 0, or a distribution) in a direction uniform on the sphere."""

    magnitude: float | Distribution

    def _check(self) -> None:
        if isinstance(self.magnitude, tuple):
            raise RandomizationError(f"magnitude = {self.magnitude}: allowed is one number or a distribution")
        low = self._magnitude().support()[0]
        if low < 0:
            raise RandomizationError(f"magnitude = {low:g}: allowed are numbers >= 0")

    def _magnitude(self) -> Distribution:
        return self.magnitude if isinstance(self.magnitude, Distribution) else Constant(self.magnitude)

    def sample(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        # Lengths come from a child generator, so that a longer draw starts with the rows of a shorter one.
        lengths: float | np.ndarray
        if isinstance(self.magnitude, float):  # asking for the protocol instead takes longer than all drawing
            lengths = self.magnitude
        else:
            lengths = self.magnitude.sample(rng.spawn(1)[0], (*shape[:-1], 1))
        vectors = rng.standard_normal(shape)
        return lengths * vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)

    def support(self) -> tuple[float, float]:
        high = self._magnitude().support()[1]
        return -high, high

    def describe(self) -> str:
        return f"random direction, length {self._magnitude().describe()}"


KINDS: dict[str, type] = {
    "constant": Constant,
    "uniform": Uniform,
    "log_uniform": LogUniform,
    "normal": Normal,
    "bernoulli": Bernoulli,
    "direction": Direction,
}


def components(distribution: Distribution) -> int:
    """Length of the longest tuple among the parameters; 1 when all are single numbers."""
    values = (getattr(distribution, field.name) for field in fields(distribution))  # type: ignore[arg-type]
    return max(len(value) if isinstance(value, tuple) else 1 for value in values)


def _fill(value: Parameter, shape: tuple[int, ...]) -> float | np.ndarray:
    if not isinstance(value, tuple):
        return value
    return np.tile(value, shape[-1] // len(value))


def _ordered(low: Parameter, high: Parameter) -> None:
    lows, highs = np.atleast_1d(low), np.atleast_1d(high)
    if 1 not in (len(lows), len(highs)) and len(lows) != len(highs):
        raise RandomizationError(f"low has {len(lows)} numbers and high {len(highs)}: counts must be equal")
    if np.any(lows > highs):
        raise RandomizationError(f"low = {_text(low)}: allowed are numbers <= high = {_text(high)}")


def _text(value: Parameter) -> str:
    if isinstance(value, tuple):
        return "(" + ", ".join(_text(item) for item in value) + ")"
    return f"{value:.3g}" if value == 0 or math.fabs(value) >= 1e-3 else f"{value:.0e}".replace("e-0", "e-")
