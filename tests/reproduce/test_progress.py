"""What is shown of a run of the workflow: a bar on a terminal, lines elsewhere, from the jobs' heartbeats."""

from __future__ import annotations

import io
import re
import sys
from pathlib import Path

import pytest

from reproduce import heartbeat
from reproduce.heartbeat import Heartbeat
from reproduce.progress import Progress
from tactile_kit.progress import duration

JOBS = {"train/a": 60.0, "train/b": 30.0, "table1": 10.0}


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    return now


def test_lines(tmp_path: Path, clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    Heartbeat(tmp_path, "table1").end("done")  # of an earlier run: must not count
    with Progress(tmp_path, JOBS) as progress:
        clock[0] = 30.0
        progress.update()
        first = Heartbeat(tmp_path, "train/a")
        clock[0] = 60.0
        first(1, 2)
        progress.update()
        first.end("done")
        Heartbeat(tmp_path, "train/b").end("failed", "ValueError: no such file")
        progress.update()
    assert capsys.readouterr().out.splitlines() == [
        "[0/3] 0 %, 0:30 gone, ? left; running: nothing yet",
        "[0/3] 30 %, 1:00 gone, 2:20 left; running: train/a 50 %",
        "[1/3] train/a: done",
        "[2/3] train/b: failed: ValueError: no such file",
    ]


def test_a_bar_on_a_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = io.StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(sys, "stdout", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "150")
    with Progress(tmp_path, JOBS) as progress:
        Heartbeat(tmp_path, "train/a").end("done")
        Heartbeat(tmp_path, "train/b")(1, 2)
        progress.update()
    shown = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", terminal.getvalue())
    assert "train/a: done" in shown
    assert re.search(r"1 of 3 jobs; train/b \d+ % .* \d+ % .*left", shown.rstrip().splitlines()[-1])


def test_by_hand_a_stage_prints_a_line_in_ten_seconds(
    tmp_path: Path, clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    beat = Heartbeat(tmp_path, "train/a", echo=True)
    for clock[0], done in ((5.0, 1), (11.0, 2), (12.0, 3), (4000.0, 4)):
        beat(done, 8)
    assert capsys.readouterr().out.splitlines() == [
        "train/a: 2 of 8, 0:33 left",
        "train/a: 4 of 8, 1:06:40 left",
    ]
    assert heartbeat.read(tmp_path, "train/a")["done"] == 4
    assert duration(95) == "1:35"


def test_a_heartbeat_half_written_is_none(tmp_path: Path) -> None:
    Heartbeat(tmp_path, "table1")
    heartbeat.file_of(tmp_path, "table1").write_text('{"state": "run')
    assert heartbeat.read(tmp_path, "table1") is None and heartbeat.read(tmp_path, "table2") is None


def test_a_heartbeat_that_can_not_be_written_ends_nothing(tmp_path: Path) -> None:
    (tmp_path / "progress").write_text("in the way")
    beat = Heartbeat(tmp_path, "table1")
    beat(1, 1)
    beat.end("done")
    assert (tmp_path / "progress").read_text() == "in the way"
