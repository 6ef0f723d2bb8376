"""The workflow as a whole: everything from nothing, nothing the second time, only dependants after a change, and after
a kill the rest. No agent is needed: without any, all artefacts are made and say what is missing.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from reproduce import owner
from reproduce.errors import BusyError
from reproduce.files import ROOT
from reproduce.plan import FIGURES, TABLES

pytestmark = pytest.mark.slow


def command(out: Path, agents: Path, *more: str) -> list[str]:
    return [
        sys.executable, "-m", "reproduce", "run", "--scale", "smoke", "--from", "pretrained",
        "--out", str(out), "--agents", str(agents), *more,
    ]  # fmt: skip


def run(out: Path, agents: Path, *more: str) -> str:
    done = subprocess.run(
        command(out, agents, *more), cwd=ROOT, capture_output=True, text=True, timeout=280, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def stamps(out: Path) -> dict[str, int]:
    files = [file for file in out.rglob("*") if file.is_file() and ".pipeline" not in file.parts]
    return {file.relative_to(out).as_posix(): file.stat().st_mtime_ns for file in files}


WANTED = {
    *(f"tables/{name}.{suffix}" for name in TABLES for suffix in ("csv", "tex")),
    *(f"figures/{name}.{suffix}" for name in FIGURES for suffix in ("svg", "png", "csv")),
    "claims.csv",
    "report/index.html",
    "report/film.csv",
}


def test_all_once_then_nothing_then_dependants_only(tmp_path):
    out, agents = tmp_path / "out", tmp_path / "agents"
    assert "done in" in run(out, agents)
    first = stamps(out)
    assert set(first) == WANTED
    assert "nothing to do" in run(out, agents)
    assert stamps(out) == first
    # One more learning curve: the figure, the claims and the report depend on it, nothing else.
    curve = agents / "oracle-pos-cube-s0"
    curve.mkdir(parents=True)
    (curve / "metrics.jsonl").write_text(
        "".join(f'{{"step": {i}, "success": 0.{i}}}\n' for i in range(1, 10))
    )
    run(out, agents)
    changed = {name for name, at in stamps(out).items() if first[name] != at}
    assert changed == {f"figures/learning.{s}" for s in ("svg", "png", "csv")} | {
        "claims.csv",
        "report/index.html",
    }
    assert "nothing to do" in run(out, agents)


def test_killed_and_run_again_it_completes(tmp_path):
    out, agents = tmp_path / "out", tmp_path / "agents"
    process = subprocess.Popen(
        command(out, agents), cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 120
    while not list((out / "tables").glob("*.csv")) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    kept = stamps(out)
    assert kept and set(kept) != WANTED  # it was killed midway
    assert "done in" in run(out, agents)
    assert {name for name in stamps(out) if not name.startswith(".")} >= WANTED
    assert "nothing to do" in run(out, agents)


def test_a_failing_job_is_named_with_its_log_and_the_rest_is_kept(tmp_path):
    out, agents = tmp_path / "out", tmp_path / "agents"
    curve = agents / "oracle-pos-cube-s0"
    curve.mkdir(parents=True)
    (curve / "metrics.jsonl").write_text('{"step": 1, "success": 7}\n')
    done = subprocess.run(
        command(out, agents), cwd=ROOT, capture_output=True, text=True, timeout=280, check=False
    )
    assert done.returncode != 0
    assert (
        "learning failed" in done.stderr
        and "metrics.jsonl, line 1" in done.stderr
        and "allowed" in done.stderr
    )
    assert "tables/table1.csv" in stamps(out) and "figures/learning.png" not in stamps(out)
    (curve / "metrics.jsonl").write_text('{"step": 1, "success": 0.1}\n{"step": 2, "success": 0.2}\n')
    run(out, agents)
    assert set(stamps(out)) == WANTED


def test_profiles_are_handed_through(tmp_path):
    profile = tmp_path / "profile"
    profile.mkdir()
    (profile / "config.yaml").write_text("executor: local\nkeep-going: true\nprintshellcmds: true\n")
    out = tmp_path / "out"
    assert "done in" in run(out, tmp_path / "agents", "--profile", str(profile), "--jobs", "3")
    (profile / "config.yaml").write_text("executor: no-such-executor\n")
    done = subprocess.run(
        command(tmp_path / "other", tmp_path / "agents", "--profile", str(profile)), cwd=ROOT,
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode != 0 and "no-such-executor" in done.stderr


def test_two_runs_do_not_share_a_folder(tmp_path):
    with (
        owner.hold(tmp_path),
        pytest.raises(BusyError, match=f"held by process {os.getpid()}"),
        owner.hold(tmp_path),
    ):
        pass
    with owner.hold(tmp_path):  # free again
        pass


def test_the_lock_of_a_dead_run_is_no_obstacle(tmp_path):
    code = (
        "import sys, time; from pathlib import Path; from reproduce import owner\n"
        "with owner.hold(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline().strip() == "held"
    with pytest.raises(BusyError, match=str(process.pid)), owner.hold(tmp_path, patience=0.5):
        pass
    process.kill()
    process.wait()
    process.stdout.close()
    with owner.hold(tmp_path, patience=5.0):
        pass
