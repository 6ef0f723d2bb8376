"""The command line and the contact sheet."""

import json
import re
import shutil
import subprocess
import sys

import matplotlib.image
import numpy as np
import pytest
import trimesh

import object_sets
from object_sets.cli import main
from object_sets.raster import render


def test_help_of_every_command():
    done = subprocess.run(
        [sys.executable, "-m", "object_sets.cli", "--help"], capture_output=True, text=True, check=True
    )
    assert all(word in done.stdout for word in ("list", "build", "check", "render"))


@pytest.mark.parametrize("arguments", [["list"], ["--help"]])
def test_a_reader_that_has_seen_enough(arguments):
    """``object-sets list | head``: no traceback, and the exit code of a process that SIGPIPE ended."""
    command = [sys.executable, "-m", "object_sets.cli", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    process.stdout.close()
    with process.stderr:
        assert process.stderr.read() == ""
    assert process.wait(timeout=60) == 141


def test_list(capsys):
    assert main(["list", "ood"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 6 and "emergency_switch" in lines[4]


def test_unknown_names_end_with_one_and_a_hint(capsys):
    assert main(["list", "geometrc8"]) == 1
    assert "nearest valid name: 'geometric8'" in capsys.readouterr().err
    assert main(["build", "ood", "--extent", "0.09:0.04", "--scales", "2"]) == 1
    assert "LOW:HIGH" in capsys.readouterr().err


def test_check(tmp_path, capsys):
    trimesh.creation.box((0.06, 0.05, 0.04)).export(tmp_path / "good.stl")
    trimesh.creation.box((60, 50, 40)).export(tmp_path / "large.stl")
    assert main(["check", str(tmp_path / "good.stl")]) == 0
    assert "ok" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "large.stl"), str(tmp_path / "good.stl")]) == 1
    text = capsys.readouterr().out
    assert "refused" in text and "remedy" in text and "good.stl: 60.0 x 50.0 x 40.0 mm" in text
    assert main(["check", str(tmp_path / "large.stl"), "--extent", "0.045:0.09"]) == 0
    assert main(["check", str(object_sets.sets.DATA)]) == 0


def test_check_of_a_set_that_was_altered(tmp_path, capsys):
    """Told as one refusal beside the files that are fine, and in the report."""
    shutil.copytree(object_sets.sets.DATA, tmp_path / "set")
    with (tmp_path / "set" / "cube.npz").open("ab") as file:
        file.write(b"more")
    trimesh.creation.box((0.06, 0.05, 0.04)).export(tmp_path / "good.stl")
    report = tmp_path / "report.json"
    places = [str(tmp_path / "set"), str(tmp_path / "good.stl")]
    assert main(["check", *places, "--report", str(report)]) == 1
    assert "1 ok, 0 repaired, 1 refused" in capsys.readouterr().out
    row = json.loads(report.read_bytes())[0]
    assert "cube.npz: sha256 does not fit" in row["defect"] and row["remedy"] == "build the set again"
    (tmp_path / "set" / "manifest.json").unlink()
    assert main(["check", str(tmp_path / "set" / "manifest.json")]) == 1
    assert "manifest.json: missing" in capsys.readouterr().out


def test_places_and_ranges_that_are_none(tmp_path, capsys):
    assert main(["build", "--meshes", str(tmp_path / "nowhere"), "--out", str(tmp_path / "set")]) == 1
    assert "nowhere: no such folder" in capsys.readouterr().err
    for extent in ("small", "0", "0.09:0.045", "0.05:inf"):
        assert main(["check", str(tmp_path / "a.stl"), "--extent", extent]) == 1
        assert f"--extent {extent!r}: LOW:HIGH in metres" in capsys.readouterr().err


def test_a_bar_on_a_terminal(tmp_path, capsys, monkeypatch):
    trimesh.creation.box((0.06, 0.05, 0.04)).export(tmp_path / "box.stl")
    assert main(["check", str(tmp_path / "box.stl")]) == 0
    assert capsys.readouterr().err == f"[1/1] {tmp_path / 'box.stl'}\n"
    monkeypatch.setenv("FORCE_COLOR", "1")  # stderr counts as a terminal
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["check", str(tmp_path / "box.stl")]) == 0
    shown = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", capsys.readouterr().err)
    assert re.search(r"box\.stl .*1/1", shown) and "[1/1]" not in shown


def test_render_sheet(tmp_path, capsys):
    assert (
        main(
            ["render", "geometric8,apple", "--out", str(tmp_path / "a.png"), "--svg", str(tmp_path / "a.svg")]
        )
        == 0
    )
    image = matplotlib.image.imread(tmp_path / "a.png")
    assert image.shape[0] > 300 and image[..., :3].std() > 0.05
    assert (tmp_path / "a.svg").read_text().count("<image") == 9
    object_sets.render_sheet(object_sets.select("geometric8,apple"), tmp_path / "b.png", tmp_path / "b.svg")
    assert (tmp_path / "b.svg").read_bytes() == (tmp_path / "a.svg").read_bytes()
    assert (tmp_path / "b.png").read_bytes() == (tmp_path / "a.png").read_bytes()


def test_empty_sheet_is_an_error(tmp_path):
    with pytest.raises(object_sets.ObjectSetError, match="no objects"):
        object_sets.render_sheet([], tmp_path / "a.png")


def test_picture_shows_the_silhouette():
    """Area of the projection of a sphere, and a notch that lets the background through."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    image = render(np.asarray(ball.vertices), np.asarray(ball.faces), (1.0, 0.5, 0.2), 120, 0.08)
    assert image.shape == (120, 120, 4)
    assert image[..., 3].mean() == pytest.approx(np.pi * 0.03**2 / 0.08**2, rel=0.02)
    assert image[0, 0, 3] == 0 and image[60, 60, 3] == 1
