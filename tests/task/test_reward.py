"""Reward terms against values worked out by hand (paper, section II-E)."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_kit.hand.kinematics import MEAN_GRASP
from tactile_kit.task.config import RewardConfig
from tactile_kit.task.reward import reward_terms

PAPER = RewardConfig()
HERE = np.zeros((1, 3))


def terms(config: RewardConfig = PAPER, **changes: np.ndarray) -> dict[str, float]:
    values = {
        "left_before": np.ones(1),
        "left": np.ones(1),
        "x_before": HERE,
        "x": HERE,
        "x_start": HERE,
        "q": MEAN_GRASP[None],
    }
    return {name: value.item() for name, value in reward_terms(config, **{**values, **changes}).items()}


def test_the_papers_coefficients() -> None:
    assert (PAPER.rotation, PAPER.rotation_clip, PAPER.position, PAPER.posture) == (1.0, 0.1, 8.0, 1 / 6)


def test_nothing_happens_nothing_is_paid() -> None:
    assert terms() == {"rotation": 0, "position": 0, "posture": 0, "drop": 0}


def test_the_paper_asks_no_price_for_a_drop_but_a_recipe_may() -> None:
    assert terms(dropped=np.array([True]))["drop"] == 0
    assert terms(config=RewardConfig(drop=1.5), dropped=np.array([True]))["drop"] == -1.5


@pytest.mark.parametrize(
    ("after", "paid"),
    [(0.95, 0.05), (0.9, 0.1), (0.5, 0.1), (0.0, 0.1), (1.05, -0.05), (2.0, -1.0)],
)
def test_the_angle_gained_is_clipped_from_above_only(after: float, paid: float) -> None:
    assert terms(left=np.array([after]))["rotation"] == pytest.approx(paid)


def test_the_way_out_costs_what_the_way_back_returns() -> None:
    near, far = np.array([[0.003, 0.0, 0.004]]), np.array([[0.0, -0.02, 0.0]])  # 5 and 20 mm from the start
    assert terms(x_before=near, x=far)["position"] == pytest.approx(-8 * 0.015)
    assert terms(x_before=far, x=near)["position"] == pytest.approx(8 * 0.015)
    start = np.array([[0.0, 0.0, 0.004]])  # distances count from where the episode began
    assert terms(x_before=HERE, x=near, x_start=start)["position"] == pytest.approx(-8 * (0.003 - 0.004))


def test_posture_is_the_sum_of_fourth_powers() -> None:
    q = MEAN_GRASP[None].copy()
    q[0, 0] += 0.5
    q[0, 7] -= 1.0
    assert terms(q=q)["posture"] == pytest.approx(-(0.5**4 + 1.0) / 6)


def test_coefficients_weigh_their_own_term() -> None:
    config = RewardConfig(rotation=2, rotation_clip=0.3, position=3, posture=5)
    x, q = np.array([[0.01, 0, 0]]), MEAN_GRASP[None] + np.eye(12)[:1]
    found = reward_terms(config, np.ones(1), np.full(1, 0.5), HERE, x, HERE, q)
    assert {name: value.item() for name, value in found.items()} == pytest.approx(
        {"rotation": 0.6, "position": -0.03, "posture": -5, "drop": 0}
    )


def test_arrival_pays_its_weight_once_and_mostly_near_the_goal() -> None:
    config = RewardConfig(arrival=2.0)

    def paid(before: float, after: float) -> float:
        return terms(config, left_before=np.array([before]), left=np.array([after]))["arrival"]

    way = [paid(3, 1), paid(1, 0.4), paid(0.4, 0)]
    assert sum(way) == pytest.approx(2.0, abs=1e-6) and way[0] < 0.05 and min(way[1:]) > 0.9
    assert paid(0, 3) == pytest.approx(-2.0, abs=1e-6)
    assert "arrival" not in terms()
