"""claims.csv: the 16 claims of the text, each reproduced, not reproduced or not measured, with the figures."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from reproduce.claims import judge_all
from reproduce.files import write_atomic
from reproduce.results import Results

COLUMNS = ("number", "claim", "verdict", "ours", "paper", "n", "unit", "scale")


def make(results: Results, outputs: Sequence[Path]) -> None:
    """``outputs``: the CSV."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(COLUMNS)
    for judged in judge_all(results):
        verdict = judged.verdict
        writer.writerow(
            [
                judged.number,
                judged.claim,
                verdict.verdict,
                verdict.figures,
                judged.paper,
                verdict.n,
                verdict.unit,
                results.scale,
            ]
        )
    write_atomic(outputs[0], buffer.getvalue())
