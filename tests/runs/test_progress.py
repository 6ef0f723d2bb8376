"""What a training shows: a bar on a terminal, now and then a line elsewhere, nothing when it is to be quiet."""

from __future__ import annotations

import io
import re
import sys

import pytest

from tactile_kit.runs.progress import Progress

LINE = {"success": 0.25, "drops": 0.5, "theta": 1.0}


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True

    def shown(self) -> str:
        """Without control codes."""
        return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", self.getvalue())


def test_a_bar_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "150")
    progress = Progress(1000, 100, "cube")
    progress.update(400, LINE)
    progress.update(500)  # between lines of metrics the last one stays
    progress.say("saved [late]")
    progress.close()
    assert "cube: saved [late]" in terminal.shown()
    last = terminal.shown().rstrip().splitlines()[-1]
    assert re.search(r"cube .*400/1,000 steps, .*left, success 0.25, drops 0.50, angle 1.00 rad", last)


def test_lines_elsewhere(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    progress = Progress(1000, label="cube")
    for clock[0], step, line in (
        (10.0, 100, LINE),
        (50.0, 150, None),
        (30.0, 200, LINE),  # too soon for another line
        (3700.0, 500, {"success": None}),
        (3701.0, 1000, LINE),  # the end is always told
    ):
        progress.update(step, line)
    said = capsys.readouterr().err.splitlines()
    assert [line.split(" steps")[0] for line in said] == [f"cube: {n}/1,000" for n in ("100", "500", "1,000")]
    assert "10/s, 1:30 left" in said[0] and "1:01:40 left" in said[1] and "success" not in said[1]
    assert "0:00 left" in said[2]


def test_more_than_was_asked_for_is_never_more_than_all(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    progress = Progress(20_000, label="cube")
    clock[0] = 100.0
    progress.begin()  # what came before does not count
    clock[0] = 101.0
    progress.update(10_000, LINE)
    clock[0] = 140.0
    progress.update(32_768, LINE)
    first, last = capsys.readouterr().err.splitlines()
    assert "10,000/s, 0:01 left" in first
    assert "32,768/32,768 steps, 819/s, 0:00 left" in last


def test_a_narrow_terminal_keeps_the_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "80")
    progress = Progress(1000, 0, "cube")
    progress.update(500, LINE)
    progress.close()
    *_, bar, more = terminal.shown().rstrip().splitlines()
    assert "━" in bar and "500/1,000 steps" in bar and more.strip().startswith("success 0.25")


def test_nothing_when_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress(10, quiet=True)
    progress.update(5, LINE)
    progress.say("heard?")
    progress.close()
    assert capsys.readouterr() == ("", "")
