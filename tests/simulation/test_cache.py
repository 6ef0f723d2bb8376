"""The cache of grasps and bodies: damaged, another's, full or gone, it costs a search at most, and says which file."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

import randomization
from object_sets import Object
from object_sets.storage import npz_bytes, read_npz, sealed
from tactile_kit.simulation import banks, bodies
from tactile_kit.simulation.banks import BulletFinder, bank_file, find_banks
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.grasps import Grasp, GraspBank, GraspError
from tactile_kit.simulation.world import World
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.vec_env import ReorientVecEnv

FIELDS = ("joints", "command", "position", "rotation")


@dataclass
class Prompt(BulletFinder):
    """Finds the grasps of a bank at once, and counts how often it is asked; refuses what is small."""

    bank: GraspBank | None = None
    asked: list[str] = field(default_factory=list)

    def find(self, thing: Object) -> Sequence[Grasp]:
        self.asked.append(thing.name)
        if thing.extents.max() < 0.01:
            raise GraspError(f"{thing.name}: too small", thing.name)
        assert self.bank is not None
        return [self.bank.grasp(0, number) for number in range(self.count)]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def finder(bank: GraspBank) -> Prompt:
    return Prompt(2, SimulationConfig(), bank=bank)


def assert_same(found: GraspBank, expected: GraspBank) -> None:
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name)[: found.count(0)])


def shifted(data: bytes) -> bytes:
    """The bank that is read without complaint, with joints a little elsewhere: as older versions wrote it."""
    arrays = read_npz(data, "bank")
    arrays.pop("digest")
    return npz_bytes({**arrays, "joints": arrays["joints"] + 0.1})


def not_a_number(data: bytes) -> bytes:
    arrays = read_npz(data, "bank")
    return npz_bytes({**arrays, "joints": np.full_like(arrays["joints"], np.nan)})


def another_sealed(data: bytes) -> bytes:
    arrays = read_npz(data, "bank")
    arrays.pop("digest")
    return sealed(arrays, "another")


DAMAGES = {
    "cut": lambda data: data[:-100],
    "empty": lambda data: b"",
    "shifted": shifted,
    "not a number": not_a_number,
    "another's": another_sealed,
    "text": lambda data: b"x" * len(data),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_bank_is_told_and_found_again(things, bank, cache, finder, caplog, damage: str) -> None:
    find_banks(finder, [(things["cube"],)])
    path = bank_file(finder, things["cube"])
    whole = path.read_bytes()
    path.write_bytes(DAMAGES[damage](whole))
    assert_same(find_banks(finder, [(things["cube"],)])[1], bank)
    assert str(path) in caplog.text and caplog.text.count("looks for them again") == 1
    assert path.read_bytes() == whole and finder.asked == ["cube", "cube"]


def test_any_flipped_bit_is_noticed(things, bank, cache, finder) -> None:
    """A bit in every part of the file; where nothing reads it, what is read is whole."""
    find_banks(finder, [(things["cube"],)])
    path = bank_file(finder, things["cube"])
    whole = path.read_bytes()
    healed = 0
    for at in range(0, 8 * len(whole), 8 * len(whole) // 150 | 1):
        data = bytearray(whole)
        data[at // 8] ^= 1 << at % 8
        path.write_bytes(data)
        before = len(finder.asked)
        assert_same(find_banks(finder, [(things["cube"],)])[1], bank)
        healed += len(finder.asked) - before
    assert healed > 100


def test_a_damaged_refusal_is_asked_for_again(things, cache, finder, caplog) -> None:
    small = things["cube"].with_extents([0.002] * 3)
    for expected in (1, 1):
        with pytest.raises(GraspError, match="too small"):
            find_banks(finder, [(small,)])
        assert len(finder.asked) == expected
    (path,) = (cache / "grasps").iterdir()
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)
    with pytest.raises(GraspError, match="too small"):
        find_banks(finder, [(small,)])
    assert len(finder.asked) == 2 and path.stem.split(".")[0] in caplog.text


def test_grasps_found_on_a_full_disk_are_used(things, cache, finder, monkeypatch, caplog) -> None:
    """/dev/full stands in for the folder's files: what is written there is refused by the kernel."""

    def full(path: Path, data: bytes) -> None:
        with open("/dev/full", "wb") as file:
            file.write(data)

    monkeypatch.setattr(banks, "write_atomic", full)
    chosen = [(things["cube"],), (things["cube"].with_extents([0.06] * 3),)]
    found, there = find_banks(finder, chosen)
    assert [thing.name for thing in found] == ["cube", "cube"] and there.count(0) == there.count(1) == 2
    assert caplog.text.count("can't be kept there (No space left on device)") == 1
    assert not list((cache / "grasps").iterdir())


def test_a_cache_without_room_is_no_reason_to_refuse(things, bank, cache, finder, monkeypatch) -> None:
    """Not even an empty file can be made; a folder that may not be written to is refused as ever."""

    def none(**_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(banks.tempfile, "TemporaryFile", none)
    assert_same(find_banks(finder, [(things["cube"],)])[1], bank)


def test_bodies_on_a_full_disk_and_damaged_ones(things, cache, monkeypatch, caplog, tmp_path) -> None:
    world, body = World(SimulationConfig()), Body(things["l_shape"])
    physics = {**randomization.preset("none").draw("episode", 0), "gravity": 9.81}
    world.load(body, physics)
    (file,) = (cache / "bodies").iterdir()
    whole = file.read_bytes()
    file.write_bytes(b"\xff" + whole[1:])  # no UTF-8 any more
    world.hand = None  # what every so many episodes brings about: the scene is built anew
    world.load(body, physics)
    assert file.read_bytes() == whole
    shutil.rmtree(cache)
    write = bodies.write_atomic

    def full(path: Path, data: bytes) -> None:
        if path.is_relative_to(cache):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(path, data)

    monkeypatch.setattr(bodies, "write_atomic", full)
    monkeypatch.setattr(bodies.tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    world.hand = None
    world.load(body, physics)
    world.close()
    assert f"{file}: can't be written (No space left on device)" in caplog.text


@pytest.mark.parametrize("workers", [0, 1])
def test_a_cache_deleted_amid_episodes_changes_nothing(cache, workers: int) -> None:
    task = TaskConfig(objects="cube,l_shape", grasps=1, horizon=3, simulation={"engine": "bullet"})
    env = ReorientVecEnv(task, num_envs=2, num_workers=workers, seed=3)
    shutil.rmtree(cache)
    env.reset()
    for _ in range(12):
        _, _, _, infos = env.step(np.zeros((2, 12), np.float32))
        assert not any(info.get("fault") for info in infos)
        shutil.rmtree(cache, ignore_errors=True)
    env.close()
