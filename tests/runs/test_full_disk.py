"""A disk that is full for a while, a real one: the training goes on, says so once, and loses nothing it can keep."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from full_disk_run import EVERY, STEPS
from toy_run import settings, toy

from tactile_kit.files import digest
from tactile_kit.runs import RunError, read_metrics, train
from tactile_kit.runs.disk import Appended, Disk
from tactile_kit.runs.metrics import MetricsFile
from tactile_kit.runs.session import Run

HERE = Path(__file__).parent
NAMESPACE = ["unshare", "--map-root-user", "--mount"]


def timeless(lines: list[dict]) -> list[dict]:
    return [
        {name: value for name, value in line.items() if name not in ("hours", "steps_per_second")}
        for line in lines
    ]


@pytest.mark.skipif(
    subprocess.run([*NAMESPACE, "true"], capture_output=True, check=False).returncode != 0,
    reason="this system lets nobody mount a file system of their own",
)
def test_a_training_outlives_a_full_disk(tmp_path: Path) -> None:
    (tmp_path / "small").mkdir()
    command = [*NAMESPACE, sys.executable, str(HERE / "full_disk_run.py"), str(tmp_path / "small")]
    places = [str(HERE.parents[1]), str(HERE), str(HERE.parent / "agents")]
    ended = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=120,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(places)},
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    found = json.loads(ended.stdout)
    train(settings(STEPS, log_every=EVERY), tmp_path / "run", make_env=toy, quiet=True)
    told = [line for line in ended.stderr.splitlines() if "saved" in line or "save " in line]
    files = ("a checkpoint", "metrics.jsonl", "tensorboard")
    expected = [f"run: could not save {file}" for file in files] + [
        f"run: {file} can be saved again" for file in files
    ]
    assert sorted(line.partition(" (")[0] for line in told) == sorted(expected)
    assert all("[Errno 28] No space left on device" in line for line in told if "could not" in line)
    lines = [json.loads(line) for line in found["metrics"].splitlines()]
    assert timeless(lines) == timeless(read_metrics(tmp_path / "run"))
    steps = [step for step, name in found["points"] if name == "training/steps_per_second"]
    assert steps == list(range(EVERY, STEPS + 1, EVERY))
    assert found["checkpoints"] == ["step-000000001536", f"step-{STEPS:012d}"]
    assert found["policy"] == digest((tmp_path / "run" / "policy.safetensors").read_bytes())


def test_a_last_save_that_fails_is_an_error_and_what_was_before_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save = Run.save

    def refused(run: Run) -> None:
        if run.learner.num_timesteps > 512:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        save(run)

    monkeypatch.setattr(Run, "save", refused)
    with pytest.raises(RunError, match=r"at 1,024 steps it could not be saved .*No space left"):
        train(settings(1024), tmp_path / "run", make_env=toy, quiet=True)
    monkeypatch.setattr(Run, "save", save)
    train(settings(1024), tmp_path / "run", make_env=toy, quiet=True)
    train(settings(1024), tmp_path / "whole", make_env=toy, quiet=True)
    for name in ("policy.safetensors", "critic.safetensors"):
        assert (tmp_path / "run" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_a_run_goes_on_where_nothing_more_can_be_written_at_its_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """config.yaml is there already; that the start is missing in run.json is told."""
    train(settings(512), tmp_path, make_env=toy, quiet=True)

    def full(path: Path, data: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("tactile_kit.runs.training.write_atomic", full)
    with pytest.raises(RunError, match=r"config\.yaml: can't be written .*No space left"):
        train(settings(1024), tmp_path, make_env=toy)
    (tmp_path / "config.yaml").write_text(settings(1024).to_yaml())
    train(settings(1024), tmp_path, make_env=toy)
    assert "could not save run.json ([Errno 28] No space left on device)" in capsys.readouterr().err


def test_a_piece_is_in_a_file_whole_or_not_at_all(tmp_path: Path) -> None:
    """A kill or a full disk may leave part of one; the kernel's limit on a file's size cuts the write in the middle."""
    code = """
import resource, sys
from pathlib import Path
from tactile_kit.runs.disk import Appended
file = Appended(Path(sys.argv[1]))
file.add(b"one\\n")
resource.setrlimit(resource.RLIMIT_FSIZE, (6, resource.RLIM_INFINITY))
for piece in (b"two\\n", b"three\\n"):
    try:
        file.add(piece)
        sys.exit("nothing was refused")
    except OSError as problem:
        assert "File too large" in str(problem)
    assert file.path.read_bytes() == b"one\\n"
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
file.flush()
"""
    path = tmp_path / "there" / "lines"
    subprocess.run([sys.executable, "-c", code, str(path)], check=True)
    assert path.read_bytes() == b"one\ntwo\nthree\n"
    later = Appended(path)
    path.write_bytes(b"one\n")  # somebody else has shortened it
    later.add(b"four\n")
    assert path.read_bytes() == b"one\nfour\n"


def test_a_disk_says_each_thing_once_until_it_works_again() -> None:
    said: list[str] = []
    disk = Disk(said.append)

    def refuse() -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    for _ in range(3):
        assert not disk.attempt("a film", "none for now", refuse)
    assert disk.attempt("a film", "none for now", lambda: None)
    assert disk.attempt("a film", "none for now", lambda: None)
    assert not disk.attempt("a film", "none for now", refuse)
    refused = "could not save a film ([Errno 5] Input/output error); none for now"
    assert said == [refused, "a film can be saved again", refused]


def test_lines_after_the_checkpoint_go_and_tensorboard_shows_one_curve(tmp_path: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    for start, steps in ((0, (1, 2, 3)), (2, (3, 4))):
        metrics = MetricsFile(tmp_path, start, Disk(pytest.fail))
        for step in steps:
            metrics.write({"step": step, "success": step + start / 10})
        metrics.write({"step": steps[-1], "evaluation": True, "success_rate": 0.5})
        metrics.close()
        with (tmp_path / "metrics.jsonl").open("a") as file:
            file.write('{"step": 4, "cut sho')
    assert [line["step"] for line in read_metrics(tmp_path)] == [1, 2, 3, 4, 4]
    board = EventAccumulator(str(tmp_path / "tensorboard"))
    board.Reload()
    assert board.Tags()["scalars"] == ["training/success", "evaluation/success_rate"]
    points = [(event.step, event.value) for event in board.Scalars("training/success")]
    assert points == [(1, 1.0), (2, 2.0), (3, pytest.approx(3.2)), (4, pytest.approx(4.2))]


def test_a_log_on_a_full_disk_ends_nothing() -> None:
    code = "import os; from tactile_kit.progress import Counter; Counter(10).say('a line'); os._exit(7)"
    with open("/dev/full", "wb") as full:
        assert subprocess.run([sys.executable, "-c", code], stderr=full, check=False).returncode == 7
