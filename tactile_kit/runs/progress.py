"""How far a training is, and how well it goes."""

from __future__ import annotations

from typing import Any

from tactile_kit.progress import Counter


class Progress(Counter):
    """Shows ``step`` of ``total`` environment steps.

    Args:
        total: steps at the end; start: steps done before; label: the run's name; quiet: show nothing.
    """

    def __init__(self, total: int, start: int = 0, label: str = "train", quiet: bool = False) -> None:
        super().__init__(total, start, label, "steps", quiet)

    def update(self, step: int, line: dict[str, Any] | None = None) -> None:
        """Show ``step`` and, from a line of metrics, success and final angle."""
        self.show(step, None if line is None else _success(line))


def _success(line: dict[str, Any]) -> str:
    if line.get("success") is None:
        return ""
    text = f", success {line['success']:.2f}, drops {line['drops']:.2f}"
    return text if line.get("theta") is None else f"{text}, angle {line['theta']:.2f} rad"
