"""Figures over the last episodes of environments that began together."""

from __future__ import annotations

import pytest

from tactile_kit.runs.metrics import Tracker


def finish(tracker: Tracker, count: int, drop: bool) -> None:
    for _ in range(count):
        tracker._add({"success": not drop, "drop": drop, "theta": 1.0, "episode": {"r": 0.0, "l": 100}})


@pytest.mark.parametrize(("num_envs", "share"), [(800, 0.25), (1, 0.0)])
def test_drops_count_until_those_that_held_have_ended_too(num_envs: int, share: float) -> None:
    """Of 800 environments 200 drop early; the others end together 100 steps after the start."""
    tracker = Tracker(num_envs)
    finish(tracker, 200, drop=True)
    assert tracker.drops == 1.0
    finish(tracker, 600, drop=False)
    assert tracker.drops == pytest.approx(share)
    again = Tracker(num_envs)
    again.restore(tracker.state())
    finish(again, 800, drop=False)
    finish(again, 800, drop=True)
    assert again.drops == (0.5 if num_envs == 800 else 1.0)
