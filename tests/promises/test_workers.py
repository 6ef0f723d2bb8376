"""Interrupted from the keyboard, a training and an environment of one's own leave no process behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tactile_kit.agents import load_agent

HERE = Path(__file__).parent
TRAINING = """
import sys
from promise_cases import settings
from tactile_kit.runs import train
train(settings("oracle", 10_000_000, num_workers=2), sys.argv[1])
"""
OWN = """
import sys
import numpy as np
import tactile_kit
from promise_cases import settings
env = tactile_kit.make_vec(settings("oracle", 1).task, num_envs=2, num_workers=2)
env.reset()
open(sys.argv[1] + "/metrics.jsonl", "w").write("{}")
while True:
    env.step(np.zeros((2, 12), np.float32))
"""


def session(leader: int) -> list[str]:
    """Names of the living processes of a session."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, rest = path.read_text().rsplit(")", 1)
        except OSError:
            continue  # it has ended meanwhile
        state, _, _, number = rest.split()[:4]
        if int(number) == leader and state != "Z":
            found.append(name)
    return found


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[str], subprocess.Popen]]:
    started = []

    def make(code: str) -> subprocess.Popen:
        environment = {
            **os.environ,
            "OMP_NUM_THREADS": "1",
            "PYTHONPATH": os.pathsep.join([str(HERE), *sys.path]),
        }
        process = subprocess.Popen(
            [sys.executable, "-c", code, str(tmp_path)], env=environment, stderr=subprocess.PIPE, text=True,
            start_new_session=True,
        )  # fmt: skip
        started.append(process)
        end = time.monotonic() + 200
        while not (tmp_path / "metrics.jsonl").exists() or not (tmp_path / "metrics.jsonl").stat().st_size:
            assert process.poll() is None and time.monotonic() < end, process.stderr.read()
            time.sleep(0.05)
        return process

    yield make
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def gone(leader: int) -> bool:
    end = time.monotonic() + 20
    while session(leader) and time.monotonic() < end:
        time.sleep(0.1)
    return not session(leader)


def test_an_interrupted_training_saves_and_leaves_nothing_behind(start, tmp_path: Path) -> None:
    process = start(TRAINING)
    assert len(session(process.pid)) >= 3
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers too
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 0 and "run again to continue" in errors and "Traceback" not in errors
    assert gone(process.pid)
    assert load_agent(tmp_path).manifest.steps > 0


def test_an_interrupted_environment_leaves_nothing_behind(start) -> None:
    process = start(OWN)
    assert len(session(process.pid)) >= 3
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == -signal.SIGINT and errors.count("Traceback") == 1
    assert gone(process.pid)
