"""The workflow on a real Slurm of this machine: all that ends jobs happens once, and the bytes are a local run's."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from loopback import NODES, Loopback, until
from safetensors.numpy import load_file

from reproduce.clusters.jobs import Jobs
from reproduce.files import ROOT
from reproduce.profiles import FOLDER

pytestmark = [pytest.mark.cluster, pytest.mark.slow, pytest.mark.timeout(2400)]

SCALE = Path(__file__).parent / "tiny.yaml"
ORACLE, TACTILE = "oracle-vec_bps-cube-s0", "tactile-vec_bps-cube-s0"
TRAINING = f"train/{ORACLE}"
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
PATIENCE = 600.0  # s, of a machine that has other work


class Running:
    """A `reproduce run` with its output in a file."""

    def __init__(self, cluster: Loopback, out: Path, profile: Path, runs: list[Running]) -> None:
        runs.append(self)
        self.out, self.text = out, out.parent / "said.txt"
        environment = ENVIRONMENT | {
            name: os.environ[name] for name in ("SLURM_CONF", "PATH", "TACTILE_KIT_CACHE")
        }
        command = [
            sys.executable, "-m", "reproduce", "run", "--scale", str(SCALE), "--from", "scratch", "--out", str(out),
            "--jobs", "8", "--profile", str(profile),
        ]  # fmt: skip
        with self.text.open("w") as output:
            self.process = subprocess.Popen(
                command, cwd=ROOT, env=environment, stdout=output, stderr=subprocess.STDOUT
            )
        self.cluster = cluster

    @property
    def said(self) -> str:
        return self.text.read_text()

    @property
    def job(self) -> str:
        """Id of the oracle's training."""
        job = Jobs(self.out / ".pipeline").read(TRAINING)
        return (job and job.id) or ""

    def state(self, job: str) -> str:
        return next((state for id, _, state in self.cluster.jobs() if id == job), "")

    def lines(self) -> int:
        """Lines of the oracle's metrics."""
        file = self.out / "agents" / ORACLE / "metrics.jsonl"
        return len(file.read_text().splitlines()) if file.is_file() else 0

    def trains_on(self, after: int) -> None:
        """Waits until the oracle's training has written more than ``after`` lines of metrics."""
        self.until(lambda: self.lines() > after, "training")

    def until(self, condition, what: str, seconds: float = PATIENCE) -> None:
        def met() -> bool:
            assert self.process.poll() is None or condition(), f"ended before: {what}\n{self.said}"
            return condition()

        until(met, seconds, what)

    def ends(self) -> int:
        return self.process.wait(PATIENCE)


@pytest.fixture
def profile(tmp_path: Path) -> Path:
    """The profile that comes along, asking more often."""
    text = (FOLDER / "slurm" / "config.yaml").read_text()
    often = re.sub(r"(?m)^seconds-between-status-checks: \d+", "seconds-between-status-checks: 1", text)
    assert often != text
    (tmp_path / "profile").mkdir()
    (tmp_path / "profile" / "config.yaml").write_text(often)
    return tmp_path / "profile"


def processes_of(home: Path) -> list[int]:
    """Those that run the job whose files are in ``home``."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            command = (process / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if b"reproduce.clusters.job" in command and str(home).encode() in command:
            found.append(int(process.name))
    return found


@pytest.fixture
def no_run_left() -> Iterator[list[Running]]:
    """Runs that a failure of the test has left behind are killed."""
    runs: list[Running] = []
    yield runs
    for run in runs:
        if run.process.poll() is None:
            run.process.kill()
            run.process.wait()


def test_through_all_that_ends_jobs(
    slurm: Loopback, tmp_path: Path, profile: Path, no_run_left: list[Running]
) -> None:
    out = tmp_path / "out"

    # An interrupt ends the jobs, with a checkpoint, and the queue is empty.
    first = Running(slurm, out, profile, no_run_left)
    first.trains_on(1)
    job = first.job
    assert TRAINING in [name for id, name, _ in slurm.jobs() if id == job]  # what squeue says
    first.process.send_signal(signal.SIGINT)
    assert first.ends() == 128 + signal.SIGINT, first.said
    assert "ended 1 running jobs of the cluster" in first.said and "run the same command again" in first.said
    until(lambda: not slurm.living(), 30, "an empty queue")
    assert list((out / "agents" / ORACLE / "checkpoints").glob("*"))

    # Killed without a word, it leaves its jobs; the same command attaches to them.
    second = Running(slurm, out, profile, no_run_left)
    second.until(
        lambda: second.job not in ("", job) and second.state(second.job) == "RUNNING", "the training's job"
    )
    second.trains_on(second.lines())
    second.process.kill()
    second.process.wait()
    job = second.job
    slurm.ask("scontrol", "suspend", job)  # or it could have ended before the third has started
    third = Running(slurm, out, profile, no_run_left)
    log = out / ".pipeline" / "snakemake.log"
    third.until(lambda: f"goes on as job {job}" in log.read_text(), "attaching")
    assert third.job == job and third.state(job) == "SUSPENDED"
    lines = third.lines()
    slurm.ask("scontrol", "resume", job)
    third.trains_on(lines)

    # A job that is cancelled by hand is tried again.
    slurm.ask("scancel", job)
    third.until(lambda: third.job not in ("", job), "another try")
    job, lines = third.job, third.lines()
    third.until(lambda: f"{TRAINING}: try 1 of 4 failed, next one follows" in third.said, "saying so")
    assert f"{TRAINING}: failed" not in third.said and "try 2 of 4" not in third.said
    third.trains_on(lines)

    # A node is lost, while what it runs hangs on: Slurm starts the job on the other one, and the older start ends.
    node = slurm.node(job)
    turn = Jobs(out / ".pipeline").home(TRAINING) / "turn"
    assert turn.read_text().startswith(f"{job}.0.")
    (older,) = processes_of(turn.parent)
    os.kill(older, signal.SIGSTOP)  # it could be at its end before Slurm notices
    slurm.kill(node)
    other = next(name for name in NODES if name != node)
    third.until(lambda: slurm.node(job) == other, "the job on the other node")
    third.until(lambda: turn.read_text().startswith(f"{job}.1."), "the job's second start")
    os.kill(older, signal.SIGCONT)
    third.until(lambda: older not in processes_of(turn.parent), "the older start's end")
    third.trains_on(third.lines())

    # The controller is away for a while.
    slurm.kill("slurmctld")
    third.until(lambda: "slurm does not answer" in third.said, "noticing")
    slurm.start_controller()
    third.until(lambda: "slurm answers again" in third.said, "the controller's return")
    assert third.ends() == 0, third.said
    slurm.start_node(node)
    text = (out / ".pipeline" / "logs" / f"{TRAINING}.log").read_text()
    assert "started again elsewhere; this start ends" in text
    assert len(re.findall(r"(?m)^--- job ", text)) >= 4  # nothing of it was overwritten

    # The same bytes as by hand, here, without interruption.
    here = tmp_path / "here"
    where = ["--scale", str(SCALE), "--from", "scratch", "--out", str(here)]
    for stage in ("objects", "grasps", "train", "evaluate"):
        subprocess.run(
            [sys.executable, "-m", "reproduce", "stage", stage, *where],
            cwd=ROOT, env=ENVIRONMENT | {"TACTILE_KIT_CACHE": os.environ["TACTILE_KIT_CACHE"]}, check=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=PATIENCE,
        )  # fmt: skip
    for run in (ORACLE, TACTILE):
        assert (out / "episodes" / run / "nominal.csv").read_bytes() == (
            here / "episodes" / run / "nominal.csv"
        ).read_bytes()
        ours, theirs = (
            load_file(next((where / "agents" / run).glob("*.safetensors"))) for where in (out, here)
        )
        assert ours.keys() == theirs.keys()
        for name in ours:
            assert ours[name].tobytes() == theirs[name].tobytes(), f"{run}: {name}"
    assert (
        json.loads((out / ".pipeline" / "evaluated" / ORACLE / "nominal.json").read_text())["episodes"] == 2
    )
