"""A randomisation: named terms, drawn from named streams, recorded and replayed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from randomization.distributions import Constant, Direction, Distribution, components
from randomization.errors import RandomizationError, nearest
from randomization.streams import stream

Value = float | bool | np.ndarray
INTERVAL = "interval:"


@dataclass(frozen=True)
class Term:
    """One randomised quantity.

    Attributes:
        name: key in the drawn values.
        distribution: what it is drawn from.
        size: components; 1 is drawn as a plain number, more as an array (size,).
        unit: SI unit as text, "1" for pure numbers.
        allowed: smallest and largest value any distribution of this term may give, in ``unit``.
        when: "run", "episode", "step" or "interval:T" (redrawn every T seconds).
        meaning: what the number does, for the documentation.
        source: where the distribution comes from.
    """

    name: str
    distribution: Distribution
    size: int
    unit: str
    allowed: tuple[float, float]
    when: str
    meaning: str
    source: str

    def __post_init__(self) -> None:
        given, (low, high) = components(self.distribution), self.distribution.support()
        if self.size % given:
            raise RandomizationError(f"{self.name} has {given} numbers: the count must divide {self.size}")
        if isinstance(self.distribution, Direction) and self.size != 3:
            raise RandomizationError(f"{self.name} has size {self.size}: a direction is allowed for 3 only")
        if low < self.allowed[0] or high > self.allowed[1]:
            limits = f"[{self.allowed[0]:g}, {self.allowed[1]:g}] {self.unit}"
            raise RandomizationError(f"{self.name} reaches from {low:g} to {high:g}: allowed is {limits}")

    @property
    def interval(self) -> float | None:
        """Seconds between draws of an interval term, else None."""
        return float(self.when.removeprefix(INTERVAL)) if self.when.startswith(INTERVAL) else None

    def draw(self, seed: int) -> Value:
        """One value: float (bool from ``Bernoulli``) for size 1, else float64 (size,), in ``unit``."""
        row = self.draw_many(seed, 1)[0]
        return row if self.size > 1 else row.item()

    def draw_many(self, seed: int, n: int) -> np.ndarray:
        """The first ``n`` values of the term's stream: (n,) for size 1, else (n, size)."""
        values = self.distribution.sample(self._generator(seed), (n, self.size))
        return values if self.size > 1 else values[:, 0]

    def _generator(self, seed: int) -> np.random.Generator:
        if isinstance(self.distribution, Constant):
            return _UNREAD  # constants read no random number, and making a generator is most of a draw's cost
        return stream(seed, "randomization", self.name)


_UNREAD = np.random.Generator(np.random.PCG64(0))


class Randomization:
    """A named set of terms. Immutable, comparable, and cheap to send to another process.

    Each term reads its own stream of the seed, named by the term: adding or changing one leaves the others'
    numbers as they were.
    """

    def __init__(self, name: str, terms: Iterable[Term], summary: str = "") -> None:
        self.name = name
        self.summary = summary
        self._terms = {term.name: term for term in terms}
        self._by_time: dict[str, tuple[Term, ...]] = {}
        for term in self._terms.values():
            self._by_time[term.when] = (*self._by_time.get(term.when, ()), term)

    @property
    def terms(self) -> Mapping[str, Term]:
        """All terms by name, in the order of the documentation."""
        return MappingProxyType(self._terms)

    def draw(self, when: str, seed: int) -> dict[str, Value]:
        """One value of every term drawn at ``when`` ("run", "episode", "step", "interval:0.5").

        Returns floats (bool from ``Bernoulli``) for terms of size 1, float64 (size,) for others, in the
        terms' units; an empty dict if this randomisation draws nothing at that time. A step or interval term
        gives the first row of ``draw_steps`` or ``draw_intervals``. Raises ``RandomizationError`` for other
        times.
        """
        times = {"run", "episode", "step", *self._by_time}
        if when not in times:
            raise RandomizationError(f"when = {when!r}: unknown" + nearest(when, times))
        return {term.name: term.draw(seed) for term in self._by_time.get(when, ())}

    def draw_steps(self, seed: int, n: int) -> dict[str, np.ndarray]:
        """Every step term for ``n`` steps at once: (n,) or (n, size). First rows don't depend on ``n``."""
        return {term.name: term.draw_many(seed, n) for term in self._by_time.get("step", ())}

    def draw_intervals(self, seed: int, duration: float) -> dict[str, np.ndarray]:
        """Every interval term for ``duration`` seconds: (k,) or (k, size) with k = ceil(duration / interval).

        Row ``int(t / term.interval)`` holds at time t.
        """
        if not (math.isfinite(duration) and duration > 0):
            raise RandomizationError(f"duration = {duration}: allowed are finite numbers > 0, in seconds")
        return {
            term.name: term.draw_many(seed, math.ceil(duration / term.interval - 1e-9))
            for term in self._terms.values()
            if term.interval is not None
        }

    def replay(self, values: Mapping[str, Any]) -> Randomization:
        """This randomisation with the given terms fixed to recorded values; the others are drawn as before.

        ``values`` is what ``draw`` returned, possibly after a round trip through JSON. Raises
        ``RandomizationError`` for unknown names, wrong sizes and values out of the allowed range.
        """
        fixed = dict(self._terms)
        for name, value in values.items():
            if name not in fixed:
                raise RandomizationError(f"replay of unknown term {name!r}" + nearest(name, fixed))
            array = np.asarray(value, dtype=float)
            size = fixed[name].size
            if array.size != size:
                raise RandomizationError(f"replay of {name} with {array.size} numbers: allowed are {size}")
            constant = Constant(array.item() if array.size == 1 else tuple(array.ravel().tolist()))
            fixed[name] = replace(fixed[name], distribution=constant, source="replayed")
        return Randomization(f"{self.name} (replayed)", fixed.values(), self.summary)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Randomization) and self._terms == other._terms

    def __hash__(self) -> int:
        return hash(tuple(self._terms.values()))

    def __repr__(self) -> str:
        return f"Randomization({self.name!r}, {len(self._terms)} terms)"
