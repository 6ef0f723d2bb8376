"""Banks of grasps: kept by content, found by any number of workers, whole or not there, refused where it says why."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from object_sets import Object
from tactile_kit.progress import Counter
from tactile_kit.simulation import banks
from tactile_kit.simulation.banks import BulletFinder, CacheError, bank_file, find_banks
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.grasps import GraspError
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.variants import prepare

FIELDS = ("joints", "command", "position", "rotation")


@dataclass
class Counted(BulletFinder):
    """Says what it was asked for."""

    asked: list[str] = field(default_factory=list)

    def find(self, thing: Object) -> list:
        self.asked.append(thing.name)
        return super().find(thing)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def files(cache: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (cache / "grasps").iterdir()}


def test_a_second_call_reads_what_the_first_found(things, bank) -> None:
    finder, steps = Counted(2, SimulationConfig()), []
    choices = [(things["l_shape"],), (things["cube"],)]
    found, again = find_banks(finder, choices, report=lambda *at: steps.append(at))
    assert not finder.asked and steps == [(2, 2)] and [thing.name for thing in found] == ["l_shape", "cube"]
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(again, name)[:2], getattr(bank, name)[2:])
        np.testing.assert_array_equal(getattr(again, name)[2:], getattr(bank, name)[:2])


@pytest.mark.parametrize("changed", ["size", "count", "seed", "physics", "hand", "spread"])
def test_another_content_is_another_bank(things, monkeypatch, changed: str) -> None:
    finder, thing = BulletFinder(2, SimulationConfig()), things["cube"]
    before = bank_file(finder, thing)
    if changed == "size":
        thing = thing.with_extents([0.0675, 0.0675, 0.0674])
    elif changed == "hand":
        monkeypatch.setattr(banks.urdf, "ARMATURE", 2e-3)
    elif changed == "physics":
        finder = BulletFinder(2, SimulationConfig(solver_iterations=101))
    else:
        finder = BulletFinder(**{"count": 2, "config": SimulationConfig(), changed: 1})
    assert bank_file(finder, thing) != before


def test_engine_and_air_are_no_matter_of_a_search_in_bullet(things) -> None:
    plain = BulletFinder(2, SimulationConfig())
    eased = BulletFinder(2, SimulationConfig(engine="compiled", drag=20.0))
    assert bank_file(plain, things["cube"]) == bank_file(eased, things["cube"])


def test_the_number_of_workers_is_no_matter(tmp_path, monkeypatch) -> None:
    """Also with sizes that are drawn, and to the bytes of the files."""
    task = TaskConfig(objects="cube,l_shape", scaling="random", variants=2, grasps=1)
    found = []
    for workers in (0, 2, 3):
        monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / str(workers)))
        steps: list[tuple[int, int]] = []
        variants = prepare(task, workers, lambda *at, to=steps: to.append(at))
        assert steps == [(number, 6) for number in range(1, 7)]
        found.append(([thing.digest for thing in variants.objects], files(tmp_path / str(workers))))
    assert found[0] == found[1] == found[2] and len(found[0][1]) == 6


def test_a_refusal_is_remembered_and_the_next_size_taken(things, cache) -> None:
    small, cube = things["cube"].with_extents([0.002] * 3), things["cube"]
    finder = Counted(1, SimulationConfig())
    said = r"cube with extents \[2. 2. 2.\] mm: 0 of 1 grasps held in 60 tries"
    for _ in range(2):
        with pytest.raises(GraspError, match=said):
            find_banks(finder, [(small,)])
    assert len(finder.asked) == 1
    for _ in range(2):
        (found,), bank = find_banks(finder, [(small, cube)])
        assert found == cube and bank.count(0) == 1
    assert len(finder.asked) == 2
    with pytest.raises(GraspError, match=f"cube: none of 2 sizes can be held; the last one: {said}"):
        find_banks(finder, [(small, small)])


def test_what_can_not_be_held_ends_a_search_of_workers(things, cache) -> None:
    small = things["cube"].with_extents([0.002] * 3)
    with pytest.raises(GraspError, match="0 of 1 grasps held in 60 tries"):
        find_banks(BulletFinder(1, SimulationConfig()), [(small,), (things["cube"],)], num_workers=2)


def test_a_cache_that_can_not_be_written_to_is_refused_before_the_search(
    things, tmp_path, monkeypatch
) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / "file" / "cache"))
    finder = Counted(1, SimulationConfig())
    with pytest.raises(CacheError, match=r"file/cache/grasps: .*TACTILE_KIT_CACHE"):
        find_banks(finder, [(things["cube"],)])
    assert not finder.asked


def test_a_search_shows_how_far_it_is(things, cache, monkeypatch, capsys) -> None:
    monkeypatch.setattr(banks, "PATIENCE", 0.0)
    monkeypatch.setattr(Counter, "EVERY", 0.0)
    finder = BulletFinder(1, SimulationConfig())
    find_banks(finder, [(things["cube"],), (things["cube"].with_extents([0.06] * 3),)])
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "grasps: 0/2 objects and sizes, 0/s, ? left"
    assert re.fullmatch(r"grasps: 1/2 objects and sizes, [\d.]+/s, \d:\d\d left", said[1])
    assert re.fullmatch(r"grasps: 2/2 objects and sizes, [\d.]+/s, 0:00 left", said[2])
    find_banks(BulletFinder(2, SimulationConfig()), [(things["cube"],)], quiet=True)
    assert not capsys.readouterr().err


SEARCH = """
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.variants import prepare
prepare(TaskConfig(objects="cube,cut_cube", scaling="random", variants=6, grasps=4), num_workers=2)
"""


@pytest.mark.slow
@pytest.mark.parametrize("with_signal", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_search_leaves_what_it_found_and_no_process(cache, with_signal: signal.Signals) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen(
        [sys.executable, "-c", SEARCH], env=environment, stderr=subprocess.DEVNULL, start_new_session=True
    )
    end = time.monotonic() + 120
    while not list((cache / "grasps").glob("[0-9a-f]*.npz")):
        assert process.poll() is None and time.monotonic() < end
        time.sleep(0.02)
    os.kill(process.pid, with_signal)
    assert process.wait(10) != 0
    while _living(process.pid):
        assert time.monotonic() < end, "workers are still there"
        time.sleep(0.05)
    found = list((cache / "grasps").glob("[0-9a-f]*.npz"))
    assert 0 < len(found) < 14
    for path in found:
        with np.load(path) as data:
            assert all(len(data[name]) == 4 for name in FIELDS)


def _living(leader: int) -> bool:
    try:
        os.killpg(leader, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.slow
def test_two_searches_at_once_do_no_harm(tmp_path, monkeypatch) -> None:
    task = TaskConfig(objects="cube", scaling="random", variants=3, grasps=2)
    monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / "alone"))
    prepare(task)
    code = (
        "from tactile_kit.task.config import TaskConfig\nfrom tactile_kit.task.variants import prepare\n"
        f"prepare(TaskConfig(**{task.model_dump(include={'objects', 'scaling', 'variants', 'grasps'})!r}))"
    )
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(sys.path),
        "TACTILE_KIT_CACHE": str(tmp_path / "both"),
    }
    both = [subprocess.Popen([sys.executable, "-c", code], env=environment) for _ in range(2)]
    assert [process.wait(120) for process in both] == [0, 0]
    assert files(tmp_path / "both") == files(tmp_path / "alone")
