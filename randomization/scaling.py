"""A randomisation with some of its terms wider or narrower: what one term at a time does to an agent."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from randomization.distributions import (
    Bernoulli,
    Constant,
    Direction,
    Distribution,
    LogUniform,
    Normal,
    Parameter,
    Uniform,
)
from randomization.errors import RandomizationError, nearest
from randomization.sampling import Randomization


def scaled(randomization: Randomization, names: Iterable[str], factor: float) -> Randomization:
    """``randomization`` with the spread of the terms ``names`` times ``factor``; 0 leaves none, 1 changes nothing.

    Uniform and log-uniform terms keep their (geometric) centre, a normal one its mean; probabilities and the lengths of
    random directions are multiplied. Every term keeps its stream: a seed draws the same numbers, further apart.

    Raises:
        RandomizationError: an unknown term, a factor below 0, or a result out of the term's allowed range.
    """
    if not (math.isfinite(factor) and factor >= 0):
        raise RandomizationError(f"factor = {factor}: allowed are finite numbers >= 0")
    terms = dict(randomization.terms)
    for name in names:
        if name not in terms:
            raise RandomizationError(f"scaling of unknown term {name!r}" + nearest(name, terms))
        wider = _wider(terms[name].distribution, factor)
        terms[name] = replace(
            terms[name], distribution=wider, source=f"{terms[name].source}, spread x {factor:g}"
        )
    return Randomization(f"{randomization.name} (scaled)", terms.values(), randomization.summary)


def _wider(distribution: Distribution, factor: float) -> Distribution:
    return _WIDER[type(distribution)](distribution, factor)


def _parameter(values: Any) -> Parameter:
    return tuple(values.tolist()) if np.ndim(values) else float(values)


def _between(low: Parameter, high: Parameter, factor: float) -> tuple[Parameter, Parameter]:
    """Both ends, moved away from or to the middle between them."""
    ends = np.array([low, high], dtype=np.float64)
    middle, half = ends.mean(axis=0), 0.5 * (ends[1] - ends[0])
    return _parameter(middle - factor * half), _parameter(middle + factor * half)


def _log_between(distribution: LogUniform, factor: float) -> LogUniform:
    ends = _between(_parameter(np.log(distribution.low)), _parameter(np.log(distribution.high)), factor)
    low, high = (_parameter(np.exp(end)) for end in ends)
    return LogUniform(low, high)


def _direction(distribution: Direction, factor: float) -> Direction:
    length = distribution.magnitude
    if isinstance(length, Distribution):
        raise RandomizationError(
            "a direction of random length: allowed for scaling are those of a fixed length"
        )
    return Direction(factor * float(length))


_WIDER: dict[type, Callable[[Any, float], Distribution]] = {
    Constant: lambda d, factor: d,
    Uniform: lambda d, factor: Uniform(*_between(d.low, d.high, factor)),
    LogUniform: _log_between,
    Normal: lambda d, factor: Normal(d.mean, _parameter(factor * np.asarray(d.std))),
    Bernoulli: lambda d, factor: Bernoulli(_parameter(factor * np.asarray(d.probability))),
    Direction: _direction,
}
