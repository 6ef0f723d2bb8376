"""How far a stage is: a small JSON file it rewrites now and then, which whoever watches reads."""

from __future__ import annotations

import contextlib
import json
import time
from pathlib import Path

from reproduce.files import write_atomic
from tactile_kit.progress import duration


class Heartbeat:
    """Callable ``(done, total)``; writes at most twice a second, to ``<pipeline>/progress/<stage>[/<item>].json``.

    By hand (``echo``) it prints plain lines instead, at most one in ten seconds.
    """

    def __init__(self, pipeline: Path, job: str, echo: bool = False) -> None:
        self.path = file_of(pipeline, job)
        self.job, self.echo = job, echo
        self._started = self._last = time.monotonic()
        self._at = (0, 1)
        self._write("running")

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self._last < (10.0 if self.echo else 0.5) and done < total:
            return
        self._last = now
        self._at = (done, max(total, 1))
        self._write("running")
        if self.echo and done:
            left = (now - self._started) / done * (total - done)
            print(f"{self.job}: {done} of {total}, {duration(left)} left", flush=True)

    def end(self, state: str, message: str = "") -> None:
        """``done`` or ``failed``; what has failed is as far as it was."""
        if state == "done":
            self._at = (1, 1)
        self._write(state, message)

    def _write(self, state: str, message: str = "") -> None:
        done, total = self._at
        beat = {"state": state, "done": done, "total": total, "message": message}
        with contextlib.suppress(OSError):  # a full disk: whoever watches sees less, and the job goes on
            write_atomic(self.path, json.dumps(beat))


def file_of(pipeline: Path, job: str) -> Path:
    return pipeline / "progress" / f"{job}.json"


def read(pipeline: Path, job: str) -> dict | None:
    """A job's last heartbeat, None if it never beat."""
    try:
        return json.loads(file_of(pipeline, job).read_text(encoding="utf-8"))
    except (FileNotFoundError, json.JSONDecodeError):
        return None


def fail(pipeline: Path, job: str, message: str) -> None:
    """Notes for a job that can't do so itself that it has failed, as far as it was."""
    _note(pipeline, job, state="failed", message=message)


def again(pipeline: Path, job: str) -> None:
    """Notes that a job is to go on from where it was; whatever its last try said is past."""
    if file_of(pipeline, job).is_file():
        _note(pipeline, job, state="running", message="")


def _note(pipeline: Path, job: str, **changes: str) -> None:
    beat = (read(pipeline, job) or {"done": 0, "total": 1}) | changes
    write_atomic(file_of(pipeline, job), json.dumps(beat))
