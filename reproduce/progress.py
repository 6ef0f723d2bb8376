"""Progress of a whole run with the time left: a live display in a terminal, plain lines otherwise."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

from reproduce import heartbeat
from reproduce.clusters.watch import Watch
from tactile_kit.progress import duration

PLAIN_EVERY = 20.0  # s between plain lines


class Progress:
    """Follows the heartbeats of the jobs that are to be run.

    ``jobs`` maps a job's name to its expected cost in core-seconds; only the proportions matter, since the time left is
    reckoned from what the finished share has taken. ``watch`` knows of jobs on a cluster, of which each has ``tries``.
    """

    def __init__(
        self, pipeline: Path, jobs: dict[str, float], watch: Watch | None = None, tries: int = 1
    ) -> None:
        self.pipeline, self.jobs = pipeline, jobs
        self.watch, self.tries = watch, tries
        if watch is not None:
            watch.say = self.say
        self.stopping = False  # everything is being ended, as somebody wished
        self._failures: dict[str, int] = {}  # tries of a job that are known to have failed
        self._started = self._last = time.monotonic()
        self._ended: set[str] = set()
        self._bar: Any = None  # rich's, in a terminal
        for job in jobs:  # what an earlier run left behind must not count
            heartbeat.file_of(pipeline, job).unlink(missing_ok=True)

    def __enter__(self) -> Progress:
        if sys.stdout.isatty():
            from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
            from rich.progress import Progress as Bar

            columns = (
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.percentage:>3.0f} %"),
                TimeElapsedColumn(),
                TextColumn("{task.fields[left]} left"),
            )
            self._bar = Bar(*columns, refresh_per_second=4)
            self._bar.start()
            self._task = self._bar.add_task("starting", total=1.0, left="?")
        return self

    def __exit__(self, *_: object) -> None:
        self.update(final=True)
        if self._bar is not None:
            self._bar.stop()

    def update(self, final: bool = False) -> None:
        """Reads the heartbeats and shows how things stand."""
        if self.stopping:
            return  # what ends now has not failed
        share = 0.0
        running = []
        total = sum(self.jobs.values()) or 1.0
        for job, cost in self.jobs.items():
            beat = heartbeat.read(self.pipeline, job)
            if beat is None:
                continue
            part = min(1.0, beat["done"] / beat["total"])
            share += cost * part / total
            if beat["state"] == "running" or (
                beat["state"] == "failed" and self._again(job, beat["message"])
            ):
                running.append(f"{job} {100 * part:.0f} %")
            elif job not in self._ended:
                self._ended.add(job)
                self.say(f"{job}: {beat['state']}" + (f": {beat['message']}" if beat["message"] else ""))
        elapsed = time.monotonic() - self._started
        left = duration(elapsed * (1 - share) / share) if share > 0.02 else "?"
        now = self._now(running)
        if self._bar is not None:
            text = f"{len(self._ended)} of {len(self.jobs)} jobs; {now or 'waiting'}"
            self._bar.update(self._task, completed=share, left=left, description=text)
        elif not final and time.monotonic() - self._last > PLAIN_EVERY:
            self._last = time.monotonic()
            self.say(
                f"{100 * share:.0f} %, {duration(elapsed)} gone, {left} left; running: {now or 'nothing yet'}"
            )

    def _again(self, job: str, why: str) -> bool:
        """Whether what failed is tried again; says so once a try. What lives was started again by its scheduler."""
        if self.watch is None:
            return False
        tried = self.watch.tries(job)
        if self.watch.alive(job) or tried in (0, self.tries):  # 0: not the cluster's
            return self.watch.alive(job)
        if tried > self._failures.get(job, 0):
            self._failures[job] = tried
            self.say(f"{job}: try {tried} of {self.tries} failed, next one follows: {why}")
        return True

    def _now(self, running: list[str]) -> str:
        """What runs, and where; on a cluster also what waits."""
        shown = running[:3]
        waiting: list[str] = []
        if self.watch is not None:
            places = [self.watch.place(text.split(" ")[0]) for text in shown]
            shown = [f"{text} on {at}" if at else text for text, at in zip(shown, places, strict=True)]
            waiting = self.watch.waiting()
        now = ", ".join(shown) + (" ..." if len(running) > 3 else "")
        return "; ".join(filter(None, [now, f"{len(waiting)} in the queue" if waiting else ""]))

    def say(self, text: str) -> None:
        """A line that stays, above the bar where there is one."""
        if self._bar is not None:
            self._bar.console.print(text, highlight=False, markup=False)
        else:
            print(f"[{len(self._ended)}/{len(self.jobs)}] {text}", flush=True)
