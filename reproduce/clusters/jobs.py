"""What is known of jobs, in files: who was handed in where, which start of it is the valid one, how it ended."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from reproduce.clusters.scheduler import Standing
from reproduce.files import write_atomic

RUNNING, SUCCESS, FAILED = "running", "success", "failed"  # what cluster-generic's status command has to say


@dataclass(frozen=True)
class Job:
    """A job that was handed in. ``inputs`` are its input files as they were then."""

    name: str  # stage/item
    scheduler: str
    token: str
    inputs: list[str]
    outputs: list[str]
    run: str  # the `reproduce run` that handed it in
    tries: int  # how often that one has
    submitted: float  # s since the epoch
    id: str | None = None  # None: being handed in, or killed while it was


class Jobs:
    """The jobs of one pipeline folder."""

    def __init__(self, pipeline: Path) -> None:
        self.folder = pipeline / "cluster"

    def home(self, name: str) -> Path:
        """The folder of one job's files."""
        return self.folder / "jobs" / name

    def write(self, job: Job) -> Job:
        write_atomic(self.home(job.name) / "job.json", json.dumps(asdict(job), indent=1) + "\n")
        return job

    def named(self, job: Job, id: str) -> Job:
        """The job with the id it was given; from now on its state can be asked for."""
        self.say(id, RUNNING)
        return self.write(replace(job, id=id))

    def read(self, name: str) -> Job | None:
        return _read(self.home(name) / "job.json")

    def all(self) -> Iterator[Job]:
        for file in sorted((self.folder / "jobs").rglob("job.json")):
            if (job := _read(file)) is not None:
                yield job

    def say(self, id: str, state: str) -> None:
        """Tells Snakemake, whose status command reads this file."""
        write_atomic(self.folder / "states" / id, state + "\n")

    def ended(self, job: Job) -> int | None:
        """The exit status that the job itself left behind, None where it left none."""
        try:
            end = json.loads((self.home(job.name) / "exit.json").read_text(encoding="utf-8"))
        except (FileNotFoundError, json.JSONDecodeError):
            return None
        return int(end["status"]) if end["turn"].split(".")[0] == job.id else None


def _read(file: Path) -> Job | None:
    try:
        return Job(**json.loads(file.read_text(encoding="utf-8")))
    except (FileNotFoundError, json.JSONDecodeError, TypeError):
        return None  # none, or another version's


def stamps(files: Sequence[str]) -> list[str]:
    """Files as they are now: names, sizes and times of change."""
    found = []
    for file in files:
        try:
            status = Path(file).stat()
            found.append(f"{file} {status.st_size} {status.st_mtime_ns}")
        except FileNotFoundError:
            found.append(f"{file} absent")
    return found


def judge(jobs: Jobs, job: Job, standing: Standing | None) -> tuple[bool, bool, str]:
    """Whether a job lives, whether it has ended well, and what to say of it where it has not.

    A start that has ended well is the end; after another one the scheduler may start the same job again.
    """
    status = jobs.ended(job)
    if status == 0:
        return False, True, ""
    if standing is not None and standing.alive:
        return True, False, ""
    if status is not None:
        return False, False, f"exit status {status}"
    if standing is None:  # long forgotten, or cancelled before it began
        return False, False, f"job {job.id} is gone and left no exit status"
    return (
        False,
        False,
        f"job {job.id}: {standing.word}" + (f" on {standing.where}" if standing.where else ""),
    )
