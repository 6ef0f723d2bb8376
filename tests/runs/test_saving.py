"""A save that fails or is killed at any point: what was there before stays whole and usable."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from toy_run import settings, toy

from tactile_kit.agents import load_agent
from tactile_kit.runs import checkpoint as checkpoints
from tactile_kit.runs import train
from tactile_kit.runs.session import Run

FIRST, SECOND = 512, 1024  # environment steps at the two saves of a run
CHANGES = ("os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.chmod", "tempfile.mkstemp", "fsync")


def in_a_child(work: Callable[[], None]) -> int:
    """Run ``work`` in a forked child; its exit code, negative for a signal, 3 for an exception."""
    child = os.fork()
    if child == 0:
        try:
            work()
            os._exit(0)
        except BaseException:
            os.write(2, traceback.format_exc().encode())
            os._exit(3)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def kill_at(number: int) -> None:
    """Kill this process right before its ``number``-th change to the file system."""
    count = 0

    def watch(event: str, arguments: tuple) -> None:
        nonlocal count
        writes = (
            event == "open" and isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR)
        )
        if writes or event in CHANGES:
            count += 1
            if count == number:
                os.kill(os.getpid(), signal.SIGKILL)

    sync = os.fsync
    os.fsync = lambda handle: (watch("fsync", ()), sync(handle))[1]
    sys.addaudithook(watch)


@pytest.fixture
def at_second_save(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Trains to the second save and hands the run over just before it; returns the run's directory."""

    def play(visit: Callable[[Run, Callable[[], None]], None], **changes) -> Path:
        save = Run.save

        def visited(run: Run) -> None:
            if run.learner.num_timesteps == SECOND:
                visit(run, lambda: save(run))
            save(run)

        monkeypatch.setattr(Run, "save", visited)
        train(settings(SECOND, **changes), tmp_path / "run", make_env=toy, quiet=True)
        monkeypatch.setattr(Run, "save", save)
        return tmp_path / "run"

    return play


def assert_usable(directory: Path) -> tuple[int, int]:
    """Checkpoint and agent load; their steps."""
    saved, messages = checkpoints.newest(directory / "checkpoints")
    assert saved is not None and not messages
    return saved.step, load_agent(directory).manifest.steps


def test_a_kill_between_any_two_changes_on_disk_loses_nothing(at_second_save, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []

    def visit(run: Run, save: Callable[[], None]) -> None:
        whole, code = run.directory, -signal.SIGKILL
        while code == -signal.SIGKILL:
            number = len(seen) + 1
            run.directory = Path(shutil.copytree(whole, tmp_path / f"killed{number:03d}"))

            code = in_a_child(lambda at=number: (kill_at(at), save()))
            seen.append(assert_usable(run.directory))
        assert code == 0  # so many changes are all there are
        run.directory = whole

    whole = at_second_save(visit)
    assert len(seen) > 40
    # checkpoint and agent are each the old or the new one, and change once, the checkpoint first
    assert seen[0] == (FIRST, FIRST) and seen[-1] == (SECOND, SECOND)
    assert seen == sorted(seen) and set(seen) == {(FIRST, FIRST), (SECOND, FIRST), (SECOND, SECOND)}
    for number in range(1, len(seen) + 1, 5):
        directory = tmp_path / f"killed{number:03d}"
        train(settings(SECOND), directory, make_env=toy, quiet=True)
        for name in ("policy.safetensors", "critic.safetensors"):
            assert (directory / name).read_bytes() == (whole / name).read_bytes()
        assert {path.name for path in directory.iterdir()} == {path.name for path in whole.iterdir()}
        load_agent(directory)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_full_disk_leaves_the_previous_checkpoint(at_second_save, share: float) -> None:
    """The kernel refuses to let any file grow beyond a limit, as a full disk would."""
    codes = []

    def visit(run: Run, save: Callable[[], None]) -> None:
        largest = max(path.stat().st_size for path in run.directory.rglob("*") if path.is_file())

        def limited() -> None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (int(share * largest),) * 2)
            with pytest.raises(OSError, match="File too large"):
                save()

        before = contents(run.directory)
        codes.append(in_a_child(limited))
        assert contents(run.directory) == before
        assert assert_usable(run.directory) == (FIRST, FIRST)

    at_second_save(visit)
    assert codes == [0]


def contents(directory: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in directory.rglob("*") if path.is_file()}


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """A folder that other users can enter."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


def test_a_read_only_directory_leaves_the_previous_checkpoint(at_second_save, open_folder: Path) -> None:
    codes = []

    def visit(run: Run, save: Callable[[], None]) -> None:
        whole = run.directory
        run.directory = Path(shutil.copytree(whole, open_folder / "run"))
        places = [path for path in [run.directory, *run.directory.rglob("*")] if path.is_dir()]
        for path in places:
            path.chmod(0o555)

        def denied() -> None:
            if os.geteuid() == 0:  # root may write anywhere
                os.setgid(65534)
                os.setuid(65534)
            with pytest.raises(PermissionError, match="checkpoints"):
                save()

        before = contents(run.directory)
        codes.append(in_a_child(denied))
        for path in places:
            path.chmod(0o755)
        assert contents(run.directory) == before
        assert assert_usable(run.directory) == (FIRST, FIRST)
        run.directory = whole

    at_second_save(visit)
    assert codes == [0]


def test_training_goes_on_after_a_save_that_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    def save(run: Run) -> None:
        if run.learner.num_timesteps != SECOND:
            return whole(run)
        limit = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limit[1]))
        try:
            whole(run)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limit)

    whole = Run.save
    monkeypatch.setattr(Run, "save", save)
    train(settings(1664), tmp_path, make_env=toy)
    assert "could not save a checkpoint ([Errno 27] File too large" in capsys.readouterr().err
    steps = [int(path.name.split("-")[1]) for path in checkpoints.listing(tmp_path / "checkpoints")]
    assert steps == [1536, 1664] and not list((tmp_path / "checkpoints").glob(".writing-*"))
