"""The paper's reward (section II-E) as named terms, batched over environments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_kit.hand.kinematics import MEAN_GRASP
from tactile_kit.task.config import RewardConfig

Array = NDArray[np.floating]

NEAR = 0.5  # rad, width of the bell of the arrival term


def reward_terms(
    config: RewardConfig,
    left_before: Array,
    left: Array,
    x_before: Array,
    x: Array,
    x_start: Array,
    q: Array,
    dropped: Array | bool = False,
) -> dict[str, Array]:
    """Terms of the reward, each ``(E,)``; their sum is the reward. Arrival is only among them where it has a weight.

    Args:
        left_before, left: angles to the goal before and after the step, ``(E,)`` rad.
        x_before, x, x_start: positions, ``(E, 3)`` m; q: true joint angles after the step, ``(E, 12)`` rad.
        dropped: whether the step ended in a drop or a fault, ``(E,)``.
    """
    away = np.linalg.norm(x - x_start, axis=-1) - np.linalg.norm(x_before - x_start, axis=-1)
    terms = {
        "rotation": config.rotation * np.minimum(left_before - left, config.rotation_clip),
        "position": -config.position * away,
        "posture": -config.posture * ((q - MEAN_GRASP) ** 4).sum(axis=-1),
        "drop": -config.drop * np.broadcast_to(dropped, away.shape),
    }
    if config.arrival:
        terms["arrival"] = arrival_term(config, left_before, left)
    return terms


def arrival_term(config: RewardConfig, before: Array, after: Array) -> Array:
    """What nearing the goal pays beside the angle gained: mostly the last half radian, ``arrival`` in all.

    The difference of a bell of the angle left, ``(E,)`` rad, so that going to and fro pays nothing. Success asks for
    0.4 rad, and the angle alone makes the last stretch worth no more than the first.
    """
    return config.arrival * (np.exp(-np.square(after / NEAR)) - np.exp(-np.square(before / NEAR)))
