"""Pages made from the code are as the code is now, and say something about everything there is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from reproduce.pages.__main__ import PAGES
from reproduce.pages.reference import METRICS, unexplained

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", PAGES)
def test_pages_are_up_to_date(name: str) -> None:
    assert (ROOT / "docs" / name).read_text(encoding="utf-8") == PAGES[name](), "`make docs` makes it anew"


def test_every_argument_is_explained() -> None:
    rows = [line for line in PAGES["commands.md"]().splitlines() if line.startswith("| `")]
    assert len(rows) > 90 and not [row for row in rows if row.endswith("|  |")]


def test_every_metric_is_explained() -> None:
    keys: set[str] = set()
    for path in (ROOT / "results" / "agents").glob("*-geometric8-s0/metrics.jsonl"):
        lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        trained = [line for line in lines if not line.get("evaluation") and "policy_loss" in line]  # PPO
        keys |= set(trained[-1]) if trained else set()
    assert unexplained(keys) == set() and len(keys) > 30
    assert keys >= {key for key in METRICS if not key.endswith("*")} - {"teacher_divergence"}
    assert unexplained({"new_metric", "fed/new"}) == {"new_metric"}
