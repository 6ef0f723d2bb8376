"""Follows jobs that are with a scheduler: one question for all of them, every now and then."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path

from reproduce import heartbeat
from reproduce.clusters import scheduler
from reproduce.clusters.jobs import FAILED, RUNNING, SUCCESS, Job, Jobs, judge
from reproduce.clusters.scheduler import Standing, Unreachable

RUN = "REPRODUCE_RUN"  # in the environment of submissions: the run they belong to
SETTLING = 60.0  # s that a file may need from a node to here
GENTLE = 45.0  # s for checkpoints when everything is to end


class Watch:
    """The jobs of one pipeline, kept up to date by ``update``; in between, what was known last.

    ``every``: seconds between questions to the scheduler.
    """

    def __init__(self, pipeline: Path, every: float, run: str, say: Callable[[str], None] = print) -> None:
        self.pipeline, self.every, self.run = pipeline, every, run
        self.jobs = Jobs(pipeline)
        self.say = say
        self._next = 0.0
        self._away: set[str] = set()  # schedulers that do not answer
        self._standings: dict[str, Standing] = {}  # by job name, of what lives
        self._gone: dict[str, float] = {}  # ids that ended without an exit status, and when that was seen
        self._told: set[str] = set()  # ids whose end is known

    def update(self, force: bool = False) -> None:
        """Asks the schedulers, if it is time, and tells Snakemake."""
        if time.monotonic() < self._next and not force:
            return
        self._next = time.monotonic() + self.every
        ours = [job for job in self.jobs.all() if job.run == self.run and job.id and job.id not in self._told]
        for name in {job.scheduler for job in ours}:
            mine = [job for job in ours if job.scheduler == name]
            try:
                standings = scheduler(name).standings([job.id for job in mine if job.id])
            except Unreachable as error:
                if name not in self._away:
                    self.say(f"{name} does not answer; jobs go on, and so does this when it does: {error}")
                self._away.add(name)
                standings = {}
                mine = [job for job in mine if self.jobs.ended(job) == 0]  # by what they left themselves
            else:
                if name in self._away:
                    self.say(f"{name} answers again")
                    self._away.discard(name)
            for job in mine:
                self._note(job, standings.get(job.id or ""))

    def _note(self, job: Job, standing: Standing | None) -> None:
        assert job.id is not None
        alive, well, why = judge(self.jobs, job, standing)
        if alive and standing is not None:
            self._standings[job.name] = standing
            self._gone.pop(job.id, None)
            self.jobs.say(job.id, RUNNING)
            return
        if self.jobs.ended(job) is None:
            # An exit status may be on its way here. A job that is just being handed in is not known yet.
            since = self._gone.setdefault(job.id, time.monotonic())
            killed = standing is not None and standing.word != "COMPLETED"
            if time.monotonic() - since < (2 * self.every if killed else SETTLING):
                return
            heartbeat.fail(self.pipeline, job.name, why)
        self._standings.pop(job.name, None)
        self._told.add(job.id)
        self.jobs.say(job.id, SUCCESS if well else FAILED)

    @property
    def jobs_known(self) -> bool:
        """Whether jobs of this run were handed in here, not by another executor of Snakemake."""
        return any(job.run == self.run for job in self.jobs.all())

    def alive(self, name: str) -> bool:
        """Whether a job is with the scheduler, as far as is known."""
        return name in self._standings

    def waiting(self) -> list[str]:
        """Jobs in the queue."""
        return [name for name, standing in self._standings.items() if standing.waiting]

    def place(self, name: str) -> str:
        """The node a job is on; empty where that isn't known."""
        standing = self._standings.get(name)
        return standing.where if standing is not None else ""

    def tries(self, name: str) -> int:
        """How often this run has handed in a job."""
        job = self.jobs.read(name)
        return job.tries if job is not None and job.run == self.run else 0

    def stop(self) -> None:
        """Ends all jobs of this run, gently first: a training writes its checkpoint. Says which go on, if any."""
        end = time.monotonic() + GENTLE
        asked: set[str] = set()
        left = self._living()
        while left and time.monotonic() < end and not self._away:
            if fresh := [job for job in left if job.id not in asked]:  # also what has begun only now
                self._end(fresh, hard=False)
                asked |= {job.id for job in fresh if job.id and not self._standings[job.name].waiting}
            time.sleep(1.0)
            left = self._living()
        if left and not self._away:
            self._end(left, hard=True)
            left = self._living()
        if left:
            some = ", ".join(f"{job.id} ({job.name})" for job in left[:20])
            what = "that could not be ended go on" if self._away else "are being ended"
            self.say(
                f"jobs {what}: {some}{' ...' if len(left) > 20 else ''}; the same command attaches to them"
            )
        elif asked:
            self.say(f"ended {len(asked)} running jobs of the cluster, and what waited")

    def _living(self) -> list[Job]:
        mine = [job for job in self.jobs.all() if job.run == self.run]
        for job in mine:
            if job.id is None:  # this process ended the submission midway
                with contextlib.suppress(Unreachable):
                    if found := scheduler(job.scheduler).find(job.token):
                        self.jobs.named(job, found)
        self.update(force=True)
        return [job for job in self.jobs.all() if job.run == self.run and self.alive(job.name)]

    def _end(self, jobs: list[Job], hard: bool) -> None:
        for name in {job.scheduler for job in jobs}:
            try:
                scheduler(name).stop([job.id for job in jobs if job.scheduler == name and job.id], hard)
            except Unreachable:
                self._away.add(name)
