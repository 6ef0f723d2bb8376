"""Which episodes the batch plays: training's, without end, or a list of them, each once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_kit.task.config import TaskConfig
from tactile_kit.task.goals import EpisodeSpec, training_episodes
from tactile_kit.task.state import EpisodeResult
from tactile_kit.task.variants import Variants

Array = NDArray[Any]


class Episodes:
    """The episodes of ``num_envs`` environments; each knows its next one ahead, so that no worker waits for it.

    Args:
        views: the physics' shared arrays, in which the next episodes are announced.
        seed: names the training episodes.
        listed: play exactly these; without it training episodes never end.

    Attributes:
        present: of every environment, from the first :meth:`begin` on.
        results: of the listed ones, in their order; None: not played yet.
        gravity: m/s^2 of the episodes announced from now on.

    Raises:
        ValueError: the list is empty, or names a variant that is not there.
    """

    def __init__(
        self,
        config: TaskConfig,
        variants: Variants,
        num_envs: int,
        views: dict[str, Array],
        seed: int,
        listed: Iterable[EpisodeSpec] | None,
    ) -> None:
        self.config, self.variants, self.num_envs, self.views = config, variants, num_envs, views
        self.listed = None if listed is None else _checked(list(listed), len(variants))
        self.gravity = config.gravity
        self.present: dict[int, EpisodeSpec] = {}
        self._number = np.full(num_envs, -1)  # place of the present episode in the list, -1: none
        self.reseed(seed)

    def reseed(self, seed: int, drawn: Array | None = None) -> None:
        """Begin anew with the training episodes of ``seed``, after the first ``drawn (E,)`` of each environment."""
        self.seed, every = seed, self.num_envs
        self._drawn = np.zeros(every, np.int64) if drawn is None else drawn.copy()
        self._sources = [
            training_episodes(self.config, self.variants, i, seed, every, int(self._drawn[i]))
            for i in range(every)
        ]
        self.announce()

    def announce(self) -> None:
        """Tell the workers of the first episodes; a list begins at its start."""
        self.results: list[EpisodeResult | None] = [None] * len(self.listed or [])
        self._queue: Iterator[int] = iter(range(len(self.results)))
        self._next = [self._draw(i) for i in range(self.num_envs)]

    def begin(self, environment: int) -> EpisodeSpec:
        """The episode that ``environment`` starts now; the one after it is announced."""
        self._number[environment], self.present[environment] = self._next[environment]
        self._next[environment] = self._draw(environment)
        return self.present[environment]

    def end(self, environment: int, result: EpisodeResult) -> None:
        """Keep how the present episode of ``environment`` ended, where it is one of the list."""
        if self._number[environment] >= 0:
            self.results[self._number[environment]] = result

    @property
    def finished(self) -> bool:
        """Whether every listed episode has its result."""
        return self.listed is not None and all(result is not None for result in self.results)

    @property
    def upcoming(self) -> Array:
        """Number of the training episode that each environment plays next, ``(E,) int64``; see ``reseed``."""
        return self._drawn - 1

    def set_gravity(self, gravity: float) -> None:
        """Gravity in m/s^2 of the episodes that start from now on (those already announced included)."""
        self.gravity = float(gravity)
        self.views["next_gravity"][:] = gravity

    def _draw(self, environment: int) -> tuple[int, EpisodeSpec]:
        """(place in the list, episode) after the next in ``environment``, announced to its worker."""
        number = -1
        if self.listed is None:
            spec = next(self._sources[environment])
            self._drawn[environment] += 1
        else:
            number = next(self._queue, -1)
            # with the list used up, environments idle on a repeat that nobody counts
            spec = self.listed[number if number >= 0 else 0]
        self.views["next_variant"][environment] = spec.variant
        self.views["next_seed"][environment] = spec.seed
        self.views["next_gravity"][environment] = self.gravity
        return number, spec


def _checked(episodes: list[EpisodeSpec], variants: int) -> list[EpisodeSpec]:
    if not episodes:
        raise ValueError("episodes is empty: allowed are one and more (None: training episodes without end)")
    for number, spec in enumerate(episodes):
        for name in ("variant", "given"):
            if not 0 <= getattr(spec, name) < variants:
                raise ValueError(
                    f"episodes[{number}].{name} = {getattr(spec, name)}: allowed are 0 to {variants - 1}"
                )
    return episodes
