"""The 16 claims of the paper's text, each a small function that tests it on our data."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from reproduce.claims import benchmark, conditioning, learning
from reproduce.claims.verdict import (
    NOT_MEASURED,
    NOT_REPRODUCED,
    REPRODUCED,
    NotMeasured,
    Test,
    Verdict,
)
from reproduce.files import read_yaml
from reproduce.results import Results

__all__ = ["NOT_MEASURED", "NOT_REPRODUCED", "REPRODUCED", "Judged", "Verdict", "judge_all"]


@dataclass(frozen=True)
class Judged:
    """A claim, its wording, the paper's figures and our verdict."""

    number: int
    claim: str
    paper: str
    verdict: Verdict


def judge_all(results: Results) -> list[Judged]:
    """All claims in order, tested on ``results``."""
    tests = {**learning.TESTS, **benchmark.TESTS, **conditioning.TESTS}
    texts = read_yaml(Path(__file__).parents[1] / "paper_values" / "claims.yaml")["claims"]
    return [
        Judged(number, text["claim"], text["paper"], judge(tests[number], results))
        for number, text in enumerate(texts, start=1)
    ]


def judge(test: Test, results: Results) -> Verdict:
    """One claim; missing or thin data give ``not measured`` with the reason."""
    try:
        return test(results)
    except NotMeasured as reason:
        return Verdict(NOT_MEASURED, str(reason), reason.n, reason.unit)
