"""Progress for people: a bar with the time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from typing import Any


class Progress:
    """Shows ``step`` of ``total`` environment steps.

    Args:
        total: steps at the end; start: steps done before; label: the run's name; quiet: show nothing.
    """

    EVERY = 30.0  # s between plain lines

    def __init__(self, total: int, start: int = 0, label: str = "train", quiet: bool = False) -> None:
        self.total, self.start, self.label, self.quiet = total, start, label, quiet
        self._begin = time.monotonic()
        self._shown = -float("inf")
        self._bar: Any = None
        if not quiet and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn
            from rich.progress import Progress as Bar

            columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[text]}"))
            self._bar = Bar(*columns, console=Console(stderr=True))
            self._task = self._bar.add_task(label, total=total, completed=start, text="")
            self._bar.start()

    def update(self, step: int, line: dict[str, Any] | None = None) -> None:
        """Show ``step`` and, from a line of metrics, success and final angle."""
        if self.quiet:
            return
        if self._bar is not None:
            text = {"text": self._text(step, line)} if line else {}  # without a line the last one stays
            self._bar.update(self._task, completed=step, **text)
            return
        now = time.monotonic()
        if line is not None and (now - self._shown >= self.EVERY or step >= self.total):
            self._shown = now
            self.say(self._text(step, line))

    def say(self, text: str) -> None:
        """One line of text."""
        if self.quiet:
            return
        if self._bar is not None:
            self._bar.console.print(f"{self.label}: {text}", highlight=False, markup=False)
        else:
            print(f"{self.label}: {text}", file=sys.stderr, flush=True)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _text(self, step: int, line: dict[str, Any] | None) -> str:
        done = step - self.start
        seconds = time.monotonic() - self._begin
        left = _duration(seconds / done * (self.total - step)) if done else "?"
        rate = done / seconds if seconds else 0.0
        text = f"{step:,}/{self.total:,} steps, {rate:,.0f}/s, {left} left"
        if line and line.get("success") is not None:
            text += f", success {line['success']:.2f}, drops {line['drops']:.2f}"
            if line.get("theta") is not None:
                text += f", angle {line['theta']:.2f} rad"
        return text


def _duration(seconds: float) -> str:
    minutes, seconds = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
