"""Goals and episodes: what is drawn before an episode starts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import randomization
from tactile_kit.rotations import octahedral, random_rotations
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.variants import Variants


@dataclass(frozen=True)
class EpisodeSpec:
    """All that decides an episode apart from the agent.

    Attributes:
        variant: which body is manipulated.
        given: whose mesh the agent is told (equal to ``variant`` but for the wrong-mesh experiments, section III-E).
        goal: goal orientation ``(3, 3)``.
        seed: of everything random in the episode: the grasp, the physics, the noise.
    """

    variant: int
    given: int
    goal: NDArray[np.float64]
    seed: int


def training_episodes(
    config: TaskConfig, variants: Variants, environment: int, seed: int, environments: int = 1, start: int = 0
) -> Iterator[EpisodeSpec]:
    """Endless episodes of ``environment``, one of ``environments``.

    Environments share the objects out equally (paper, section II-G): where their number is a multiple of the number of
    objects each keeps to one object, otherwise they take turns, so that none is left out. ``start`` skips so many.
    """
    number = start
    while True:
        sizes = variants.of_object((environment + number * environments) % variants.number_of_objects)
        generator = randomization.stream(seed, "episode", environment, number)
        variant = int(sizes[generator.integers(len(sizes))])
        goal = draw_goal(config, generator)
        yield EpisodeSpec(variant, variant, goal, int(generator.integers(2**62)))
        number += 1


def draw_goal(config: TaskConfig, generator: np.random.Generator) -> NDArray[np.float64]:
    """A goal orientation ``(3, 3)`` as the task draws them."""
    if config.goals == "so3":
        return random_rotations(generator, 1)[0]
    return octahedral()[generator.integers(24)]
