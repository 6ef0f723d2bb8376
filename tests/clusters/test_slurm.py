"""Slurm itself, with jobs that take no time: a training over its time limit, and jobs found by what was handed in."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path

import pytest
from loopback import Loopback, until

from reproduce.clusters.scheduler import Request, SchedulerError, Unreachable
from reproduce.clusters.slurm import Slurm
from reproduce.files import ROOT

pytestmark = [pytest.mark.cluster, pytest.mark.slow, pytest.mark.timeout(600)]

# In place of a training: the first start ends by SIGTERM as one with a checkpoint does, the second is done.
STAGE = """
import signal, sys, time
import reproduce.cli, reproduce.clusters.job as job
from pathlib import Path

def stage(arguments):
    if sys.argv[2].endswith(".1"):
        return 0
    told = []
    signal.signal(signal.SIGTERM, lambda *_: told.append(1))
    while not told:
        time.sleep(0.1)
    return job.STOPPED

reproduce.cli.main = stage
sys.exit(job.main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), sys.argv[4:]))
"""


def request(home: Path, script: str, **changes) -> Request:
    settings = {
        "name": "train/a", "token": "a-token", "script": f"#!/bin/sh\n{script}\n", "output": str(home / "output"),
        "threads": 1, "mem_mb": 100, "minutes": 1, "resources": {},
    }  # fmt: skip
    return Request(**settings | changes)


def test_a_training_longer_than_its_limit_goes_on_as_the_same_job(slurm: Loopback, tmp_path: Path) -> None:
    scheduler = Slurm()
    (tmp_path / "stage.py").write_text(STAGE)
    command = shlex.join([sys.executable, str(tmp_path / "stage.py"), str(tmp_path)])
    script = f'export PYTHONPATH={shlex.quote(str(ROOT))}\nexport AGAIN="{scheduler.again}"\n'
    id = scheduler.submit(request(tmp_path, f'{script}exec {command} "{scheduler.turn}" 1 objects'))
    assert scheduler.find("a-token") == id and scheduler.find("another") is None
    assert scheduler.standings([id])[id].alive
    until((tmp_path / "exit.json").is_file, 300, "the end of the second leg")
    end = json.loads((tmp_path / "exit.json").read_text())
    assert end["turn"].startswith(f"{id}.1.") and end["status"] == 0
    assert ": its 1 minutes are over; goes on in the next leg" in (tmp_path / "output").read_text()


def test_gently_and_hard(slurm: Loopback, tmp_path: Path) -> None:
    scheduler = Slurm()
    script = "trap 'echo told >> told' TERM\ntouch up.$SLURM_JOB_ID\nwhile true; do sleep 0.2; done"
    ids = [
        scheduler.submit(request(tmp_path, f"cd {tmp_path}\n{script}")),
        # more than there is free: waits
        *[scheduler.submit(request(tmp_path, f"cd {tmp_path}\n{script}", threads=64)) for _ in range(2)],
    ]
    until(lambda: sum(one.waiting for one in scheduler.standings(ids).values()) == 1, 30, "one in the queue")
    until(lambda: len(list(tmp_path.glob("up.*"))) == 2, 30, "two at work")
    scheduler.stop(ids)
    until((tmp_path / "told").is_file, 30, "SIGTERM")
    until(lambda: sum(one.alive for one in scheduler.standings(ids).values()) == 2, 30, "an empty queue")
    scheduler.stop(ids, hard=True)
    until(lambda: not any(one.alive for one in scheduler.standings(ids).values()), 60, "the end")
    scheduler.stop(ids)  # long over: nothing happens


def test_refusals(slurm: Loopback, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scheduler = Slurm()
    with pytest.raises(SchedulerError, match=r"[Ii]nvalid partition"):
        scheduler.submit(request(tmp_path, "true", resources={"slurm_partition": "none"}))
    other = slurm.folder / "away.conf"
    text = slurm.configuration.read_text()
    port = next(line for line in text.splitlines() if line.startswith("SlurmctldPort="))
    other.write_text(text.replace(port, "SlurmctldPort=1"))
    monkeypatch.setenv("SLURM_CONF", str(other))
    with pytest.raises(Unreachable):
        scheduler.standings(["1"])
    monkeypatch.setenv("PATH", "")
    with pytest.raises(SchedulerError, match="squeue: no such command here"):
        scheduler.standings(["1"])
