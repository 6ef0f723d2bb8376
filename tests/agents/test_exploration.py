"""Exploration noise: unit variance, its correlation, few fingers at a time, and a state that continues exactly."""

from __future__ import annotations

import pytest
import torch

from tactile_kit.agents.config import ExplorationConfig
from tactile_kit.agents.exploration import CALM, LIFT, PHASES, Exploration


def noise(config: ExplorationConfig, steps: int = 400, environments: int = 64) -> torch.Tensor:
    exploration = Exploration(config, 12, torch.Generator().manual_seed(0))
    return torch.stack([exploration.draw(environments) for _ in range(steps)])


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_variance_and_correlation(correlation: float) -> None:
    drawn = noise(ExplorationConfig(correlation=correlation))
    assert drawn.var() == pytest.approx(1.0, abs=0.03)
    assert (drawn[1:] * drawn[:-1]).mean() == pytest.approx(correlation, abs=0.03)


def test_one_or_two_fingers_reach_while_the_others_are_calm() -> None:
    exploration = Exploration(
        ExplorationConfig(few_fingers=1.0, few_reach=4.0), 12, torch.Generator().manual_seed(0)
    )
    for _ in range(200):
        exploration.draw(64)
    reach = exploration.reach.reshape(64, 4, 3)
    assert (reach == reach[..., :1]).all()  # a finger as a whole
    assert sorted(reach.unique().tolist()) == pytest.approx([CALM, 4.0])
    assert set((reach[..., 0] == 4.0).sum(1).tolist()) == {1, 2}


def test_the_moving_fingers_stay_the_same_for_a_second_on_average() -> None:
    exploration = Exploration(ExplorationConfig(few_fingers=1.0), 12, torch.Generator().manual_seed(0))
    exploration.draw(500)
    exploration.reach = torch.zeros(500, 12)
    exploration.draw(500)
    changed = (exploration.reach != 0).any(1).float().mean()
    assert changed == pytest.approx(0.1, abs=0.04)


def test_a_restored_state_continues_exactly() -> None:
    config = ExplorationConfig(correlation=0.7, few_fingers=0.5, regrasps=0.2)
    one = Exploration(config, 12, torch.Generator().manual_seed(1))
    for _ in range(30):
        one.draw(8)
        one.regrasp(torch.zeros(8, 12))
    two = Exploration(config, 12, torch.Generator())
    two.generator.set_state(one.generator.get_state())
    two.restore(one.state())
    for _ in range(30):
        torch.testing.assert_close(one.draw(8), two.draw(8), rtol=0, atol=0)
        torch.testing.assert_close(
            one.regrasp(torch.zeros(8, 12)), two.regrasp(torch.zeros(8, 12)), rtol=0, atol=0
        )


def test_actions_must_make_whole_fingers() -> None:
    with pytest.raises(ValueError, match="4 actions"):
        Exploration(ExplorationConfig(few_fingers=0.5), 4, torch.Generator())


def test_a_regrasp_lifts_one_finger_moves_it_and_sets_it_down() -> None:
    exploration = Exploration(ExplorationConfig(regrasps=1.0), 12, torch.Generator().manual_seed(0))
    held = 0.3 * torch.ones(200, 12)
    course = torch.stack([exploration.regrasp(held) for _ in range(6)]).reshape(6, 200, 4, 3)
    moved = (course != 0.3).any(3)
    assert (moved.any(0).sum(1) == 1).all()  # one finger, the others are the policy's
    finger = course[:, torch.arange(200), moved.any(0).int().argmax(1)]
    opened = 0.3 - finger[0, :, 1]
    assert opened.min() >= LIFT[0] - 1e-6 and opened.max() <= LIFT[1] + 1e-6 and opened.std() > 0.05
    assert (finger[0, :, 0] == 0.3).all()  # up first
    assert (finger[4, :, 0] - 0.3).abs().mean() > 0.2  # then sideways
    longest = 3 * (PHASES[1] - 1)
    for _ in range(longest - 6):
        exploration.regrasp(held)
    assert exploration.clock.max() <= longest


def test_without_regrasps_actions_are_the_policys() -> None:
    exploration = Exploration(ExplorationConfig(), 12, torch.Generator())
    actions = torch.rand(5, 12)
    assert exploration.regrasp(actions) is actions
