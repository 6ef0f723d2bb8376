"""What commands print: words at once on stderr, results on stdout, as a table for people and as JSON for programs."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any


def say(text: str) -> None:
    """One line for whoever waits."""
    print(text, file=sys.stderr, flush=True)


def dumps(value: Any) -> str:
    """One line of JSON."""
    return json.dumps(value, allow_nan=False)


@contextmanager
def counted(label: str, unit: str) -> Iterator[Callable[[int, int], None]]:
    """A callable (done, total) that shows a bar, begun when it is first called."""
    from tactile_kit.progress import Counter

    counter: Counter | None = None

    def show(done: int, total: int) -> None:
        nonlocal counter
        if counter is None:
            counter = Counter(total, label=label, unit=unit)
        counter.show(done)

    try:
        yield show
    finally:
        if counter is not None:
            counter.close()


def tell(summary: dict[str, Any], programs: bool) -> None:
    """The results of an evaluation: the table of its file, and the summary as JSON.

    The table is left out for ``programs``, the JSON where a terminal shows the table.
    """
    if not programs:
        from tactile_kit.evaluation import read_rows

        print(evaluation_table(read_rows(summary["out"]), summary["out"]))
    if programs or not sys.stdout.isatty():
        print(dumps(summary))


def evaluation_table(rows: Sequence[Any], out: str) -> str:
    """Success with its interval, drops and mean final angle of each object and of all, as people read them."""
    from tactile_kit.evaluation import final_angles, group, success_rate

    lines = [("", "success", "95 % interval", "drops", "final angle", "episodes")]
    for name, part in [*group(rows, lambda row: row.object).items(), ("all", rows)]:
        rate, angles = success_rate(part), final_angles(part)
        lines.append(
            (
                name,
                f"{rate.value:.2f}",
                f"{rate.low:.2f} to {rate.high:.2f}",
                str(sum(row.drop for row in part)),
                f"{angles.mean():.2f} rad" if len(angles) else "-",
                str(rate.n),
            )
        )
    return "\n".join([*columns(lines), f"rows: {out}"])


def columns(lines: Sequence[Sequence[str]], left: Sequence[int] = (0,)) -> list[str]:
    """Lines of cells set in columns, to the right but for the columns ``left``."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if at in left else cell.rjust(width) for at, (cell, width) in enumerate(pairs)
        ).rstrip()
        for pairs in (list(zip(line, widths, strict=True)) for line in lines)
    ]
