"""What is known of jobs without asking a scheduler: how they ended, which start counts, what is said of tries."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from reproduce import heartbeat
from reproduce.clusters.jobs import Job, Jobs, judge, stamps
from reproduce.clusters.scheduler import Standing
from reproduce.clusters.watch import Watch
from reproduce.files import ROOT
from reproduce.heartbeat import Heartbeat
from reproduce.progress import Progress

NAME = "train/a"


def handed_in(pipeline: Path, id: str | None = "12", tries: int = 1) -> tuple[Jobs, Job]:
    jobs = Jobs(pipeline)
    return jobs, jobs.write(Job(NAME, "slurm", "token", [], [], "this run", tries, 0.0, id))


def ends(jobs: Jobs, turn: str, status: int) -> None:
    (jobs.home(NAME) / "exit.json").write_text(json.dumps({"turn": turn, "status": status}))


def test_what_a_job_left_behind_counts_first(tmp_path: Path) -> None:
    jobs, job = handed_in(tmp_path)
    running, cancelled = Standing(True, where="node1"), Standing(False, where="node1", word="CANCELLED")
    assert judge(jobs, job, running) == (True, False, "")
    assert judge(jobs, job, cancelled) == (False, False, "job 12: CANCELLED on node1")
    assert judge(jobs, job, None) == (False, False, "job 12 is gone and left no exit status")
    ends(jobs, "11.0", 0)  # an earlier job of that name
    assert judge(jobs, job, running) == (True, False, "")
    ends(jobs, "12.1", 0)
    assert judge(jobs, job, running) == (False, True, "")  # about to end there
    ends(jobs, "12.1.e5", 2)
    assert judge(jobs, job, running) == (True, False, "")  # the scheduler may start it again
    assert judge(jobs, job, None) == (False, False, "exit status 2")


def test_jobs_are_found_again_and_foreign_files_are_none(tmp_path: Path) -> None:
    jobs, job = handed_in(tmp_path)
    assert jobs.read(NAME) == job and list(jobs.all()) == [job]
    (jobs.home(NAME) / "job.json").write_text('{"name": "train/a", "something": "else"}')
    assert jobs.read(NAME) is None and not list(jobs.all())


def test_stamps_tell_changed_files(tmp_path: Path) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text("a")
    before = stamps([str(file), str(tmp_path / "none")])
    assert before == stamps([str(file), str(tmp_path / "none")]) and before[1].endswith("absent")
    os.utime(file, (1, 1))
    assert before != stamps([str(file), str(tmp_path / "none")])


def test_a_start_that_was_replaced_ends_and_says_nothing(tmp_path: Path) -> None:
    """What runs on the node, by the command that the scheduler runs; the stage is one that waits."""
    code = (
        "import sys, time, reproduce.cli, reproduce.clusters.job as job\n"
        "from pathlib import Path\n"
        "reproduce.cli.main = lambda arguments: time.sleep(60) or 0\n"
        "job.main(Path(sys.argv[1]), '12.0', 0, ['objects'])"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert "--- job 12.0." in process.stdout.readline()
    (tmp_path / "turn").write_text("12.1")
    assert "started again elsewhere" in process.stdout.readline()
    process.stdout.close()
    assert process.wait(30) != 0
    assert not (tmp_path / "exit.json").exists()


def test_a_try_that_failed_is_no_failure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    watch = Watch(tmp_path, 1.0, "this run")
    with Progress(tmp_path, {NAME: 1.0}, watch, tries=2) as progress:
        handed_in(tmp_path, tries=1)
        beat = Heartbeat(tmp_path, NAME)
        beat(9, 9)
        beat.end("failed", "no memory")
        progress.update()
        progress.update()
        heartbeat.again(tmp_path, NAME)  # as its next try is handed in
        handed_in(tmp_path, "13", tries=2)
        progress.update()
        beat = Heartbeat(tmp_path, NAME)
        beat.end("failed", "no disk")
        progress.update()
    assert capsys.readouterr().out.splitlines() == [
        "[0/1] train/a: try 1 of 2 failed, next one follows: no memory",
        "[1/1] train/a: failed: no disk",
    ]
