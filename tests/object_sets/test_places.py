"""Where sets come from and go to: paths that can't be written, stale files, names of sets and of single objects."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

import object_sets
from object_sets import ObjectSetError, UnknownObjectError
from object_sets.cli import main
from object_sets.sets import addresses

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def meshes(tmp_path, monkeypatch):
    monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "meshes"
    folder.mkdir()
    trimesh.creation.box((0.06, 0.05, 0.07)).export(folder / "mug.stl")
    trimesh.creation.box((0.05, 0.05, 0.05)).export(folder / "die.stl")
    return folder


@pytest.mark.parametrize("place", ["a_file/set", "/proc/nowhere/set"])
def test_an_output_that_cannot_be_written_is_found_first(place, meshes, tmp_path):
    (tmp_path / "a_file").write_text("no folder")
    seen = []
    for make in (
        lambda out: object_sets.build(out, meshes=meshes, progress=lambda *done: seen.append(done)),
        lambda out: object_sets.sample(out, "prism", 1, progress=lambda *done: seen.append(done)),
    ):
        with pytest.raises(ObjectSetError, match=f"output .*{place}: can't be written"):
            make(tmp_path / place)
    assert not seen


def test_a_cache_that_cannot_be_written_is_found_first(meshes, tmp_path, monkeypatch):
    monkeypatch.setenv("TACTILE_KIT_CACHE", "/proc/nowhere")
    with pytest.raises(ObjectSetError, match="cache /proc/nowhere: can't be written"):
        object_sets.build(tmp_path / "set", meshes=meshes)
    assert not (tmp_path / "set").exists()


def test_a_report_that_cannot_be_written_is_found_first(meshes, tmp_path, capsys):
    for report in ("/proc/nowhere/report.json", str(tmp_path)):
        assert main(["check", str(meshes), "--report", report]) == 1
        text = capsys.readouterr()
        assert "--report" in text.err and "[1/" not in text.err


def test_check_of_nothing_is_an_error(capsys):
    assert main(["check"]) == 1
    assert "nothing to check" in capsys.readouterr().err


def test_files_of_an_earlier_build_go(meshes, tmp_path):
    out = tmp_path / "set"
    object_sets.build(out, meshes=meshes)
    (out / "notes.txt").write_text("mine")
    (meshes / "mug.stl").rename(meshes / "cup.stl")
    object_sets.build(out, meshes=meshes)
    assert sorted(path.name for path in out.iterdir()) == ["cup.npz", "die.npz", "manifest.json", "notes.txt"]
    (out / "manifest.json").write_text("{}")
    with pytest.raises(ObjectSetError, match="holds another set, and which files are its can't be told"):
        object_sets.build(out, meshes=meshes)


def test_a_set_is_a_path_a_list_or_one_of_its_objects(meshes, tmp_path):
    out = object_sets.build(tmp_path / "my_set", meshes=meshes).parent
    assert object_sets.select(out).names == ("die", "mug")
    assert object_sets.select(str(out / "manifest.json")).names == ("die", "mug")
    assert object_sets.select(f"{out}/mug").names == ("mug",)
    assert object_sets.select([out / "mug", "ood/cube", "3"]).names[:2] == ("mug", "cube")
    assert object_sets.select([out, "ood"]).names[:3] == ("die", "mug", "cube")
    with pytest.raises(UnknownObjectError, match=r"object 'mugg' of .*nearest valid name: 'mug'"):
        object_sets.select(f"{out}/mugg")
    for place, thing in addresses([out, "cube", "geometric8"]).items():
        assert object_sets.select(place).objects == (thing,)


def test_sizes_are_addressed_too(meshes, tmp_path):
    out = object_sets.build(tmp_path / "my_set", meshes=meshes, extent=(0.045, 0.09), scales=2).parent
    assert list(addresses(out)) == [f"{out}/{name}" for name in ("die_000", "die_001", "mug_000", "mug_001")]
    assert object_sets.select(f"{out}/mug_001").names == ("mug_001",)


def test_raw_meshes_are_answered_with_the_command(meshes, capsys):
    for ask in (object_sets.select, object_sets.load):
        with pytest.raises(UnknownObjectError, match=f"object-sets build --meshes {meshes} --out meshes_set"):
            ask(str(meshes))
    with pytest.raises(UnknownObjectError, match=f"build --meshes {meshes.parent} --recursive"):
        object_sets.select(str(meshes.parent))
    with pytest.raises(UnknownObjectError, match=f"build --meshes {meshes} --out"):
        object_sets.select(str(meshes / "mug.stl"))
    assert main(["render", str(meshes)]) == 1
    assert "make a set of them" in capsys.readouterr().err


WORK = """
import os
asked = os.access
os.access = lambda path, mode, **more: not str(path).endswith("tactile_kit") and asked(path, mode, **more)
import tactile_kit, object_sets
os.access = asked
import numpy as np
from tactile_kit.hand import inverse
inverse.tips(np.zeros(12))
object_sets.build("set", meshes="meshes")
"""


def test_a_user_without_a_home(meshes, tmp_path):
    """As in a container that runs as any user: no home to write to, nor the installed package.

    Root may write anywhere but to /proc, so there the package says of itself that it can't be written to.
    """
    environment = {"PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT)}
    environment |= {"TMPDIR": str(tmp_path), "HOME": "/proc/nowhere"}
    done = subprocess.run(
        [sys.executable, "-c", WORK], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "set" / "manifest.json").is_file()
    assert any((tmp_path / f"tactile-kit-{os.getuid()}" / "numba").rglob("*.nbi"))
