"""How commands end: one line and a status, whoever ends them; a training says what a kill has cost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from reproduce.ending import status_of
from reproduce.files import ROOT

ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}


def reproduce(*arguments: str, **settings) -> subprocess.Popen:
    command = [sys.executable, "-m", "reproduce", *arguments]
    return subprocess.Popen(command, env=ENVIRONMENT, stderr=subprocess.PIPE, text=True, **settings)


def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    process = reproduce("--help", stdout=writing)
    os.close(writing)
    assert process.communicate(timeout=60)[1] == "" and process.returncode == 128 + signal.SIGPIPE


def test_another_broken_pipe_is_one(capfd: pytest.CaptureFixture[str]) -> None:
    def command() -> int:
        raise BrokenPipeError("a worker is gone")

    with pytest.raises(BrokenPipeError, match="a worker is gone"):
        status_of(command)


def test_a_full_disk_is_one_line(capfd: pytest.CaptureFixture[str]) -> None:
    def command() -> int:
        with open("/dev/full", "w") as file:
            file.write("a table")
        return 0

    assert status_of(command) == 2
    assert (
        capfd.readouterr().err
        == "reproduce: the disk refuses to be written to: [Errno 28] No space left on device\n"
    )


@pytest.mark.parametrize(
    "number, status, word", [(signal.SIGTERM, 143, "terminated"), (signal.SIGINT, 130, "interrupted")]
)
def test_signals_end_with_one_line(
    number: int, status: int, word: str, capfd: pytest.CaptureFixture[str]
) -> None:
    before = signal.getsignal(signal.SIGTERM)
    closed = []

    def command() -> int:
        try:
            os.kill(os.getpid(), number)
            time.sleep(10)
        finally:
            closed.append(True)
        return 0

    assert status_of(command) == status and closed
    assert capfd.readouterr().err == f"reproduce: {word}\n"
    assert signal.getsignal(signal.SIGTERM) is before


def wait_for(file: Path, process: subprocess.Popen, size: int = 1) -> None:
    end = time.monotonic() + 100
    while not file.exists() or file.stat().st_size < size:
        assert process.poll() is None and time.monotonic() < end, process.communicate()
        time.sleep(0.05)


def test_training_speaks_stops_and_says_what_a_kill_cost(tmp_path: Path) -> None:
    config, out = tmp_path / "long.yaml", tmp_path / "long"
    config.write_text(
        "{preset: ppo-smoke, objects: cube, encoding: pos, steps: 100000000, task: {grasps: 4}}"
    )
    train = ("train", str(config), "--out", str(out))

    process = reproduce(*train, stdout=subprocess.PIPE)
    assert process.stderr.readline() == f"long: 100,000,000 steps as {config} says; loads what it needs\n"
    wait_for(out / "metrics.jsonl", process)
    process.send_signal(signal.SIGTERM)
    said, errors = process.communicate(timeout=60)
    lines = errors.splitlines()
    assert process.returncode == 130 and said == "", errors
    assert "stopped at" in lines[-1] and "run again to continue" in lines[-1]
    assert sum("stopped" in line for line in lines) == 1 and "Traceback" not in errors

    size = (out / "metrics.jsonl").stat().st_size
    process = reproduce(*train, stdout=subprocess.PIPE)
    wait_for(out / "metrics.jsonl", process, size + 1)
    process.kill()
    killed = process.pid
    assert "killed" not in process.communicate()[1]  # the one before had stopped by itself

    process = reproduce(*train, stdout=subprocess.PIPE)
    lines = [process.stderr.readline() for _ in range(3)]
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60)
    assert f"process {killed} on " in lines[1] and "steps (0:" in lines[1] and "are lost" in lines[1]
    assert "goes on at" in lines[2]
