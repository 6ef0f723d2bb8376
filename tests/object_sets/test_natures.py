"""Units, ranges, and files that are something else than what their name says."""

import gzip
import json

import numpy as np
import pytest
import trimesh

import object_sets
from object_sets import MeshError, ScaleError
from object_sets.cli import main
from object_sets.importing import ImportConfig, import_mesh

SIDES = np.array([0.06, 0.05, 0.07])


def box(path, factor=1.0):
    trimesh.creation.box(SIDES * factor).export(path)
    return path


@pytest.mark.parametrize(
    ("units", "factor"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0), ("inch", 1 / 0.0254)]
)
@pytest.mark.parametrize("ending", ["stl", "obj", "glb"])
def test_units(units, factor, ending, tmp_path):
    mesh = import_mesh(box(tmp_path / f"mesh.{ending}", factor), ImportConfig(units=units))
    assert np.allclose(np.ptp(mesh.vertices, axis=0), SIDES, atol=1e-6)


def test_3mf_keeps_its_own_unit(tmp_path):
    mesh = import_mesh(box(tmp_path / "mesh.3mf", 1000.0), ImportConfig(units="inch"))
    assert np.allclose(np.ptp(mesh.vertices, axis=0), SIDES, atol=1e-6)


@pytest.mark.parametrize(
    ("factor", "hint"),
    [
        (1000.0, r"mm: 70 mm large"),
        (100.0, r"mm: 7 mm large; cm: 70 mm large; inch: 177.8 mm large"),
        (1e5, "scale it"),
    ],
)
def test_a_wrong_unit_is_guessed(factor, hint, tmp_path):
    with pytest.raises(MeshError, match=rf"allowed are 0.005 to 0.5 m; remedy: .*{hint}"):
        import_mesh(box(tmp_path / "mesh.stl", factor), ImportConfig())


def test_units_on_the_command_line(tmp_path, capsys):
    path = box(tmp_path / "mesh.stl", 1000.0)
    assert main(["check", str(path)]) == 1
    assert "say its unit (mm: 70 mm large)" in capsys.readouterr().out
    assert main(["check", str(path), "--units", "mm"]) == 0
    assert "60.0 x 50.0 x 70.0 mm" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("extent", "hint"),
    [((45, 90), "45:90 looks like mm"), ((4.5, 9.0), "4.5:9 looks like mm"), ((0.001, 0.05), "hold")],
)
def test_ranges_that_no_hand_holds(extent, hint, tmp_path, capsys):
    with pytest.raises(ScaleError, match=f"0.005 to 0.5 m are what a hand can (hold; )?{hint}"):
        ImportConfig(extent=extent)
    with pytest.raises(ScaleError, match=hint):
        object_sets.build(tmp_path / "out", set_name="ood", extent=extent)
    with pytest.raises(ScaleError, match=hint):
        object_sets.sample(tmp_path / "out", "prism", 1, extent=extent)
    assert main(["build", "ood", "--out", str(tmp_path / "out"), "--extent", f"{extent[0]}:{extent[1]}"]) == 1
    assert "are what a hand can hold" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


BINARY = trimesh.creation.box(SIDES).export(file_type="stl")
ASCII = trimesh.exchange.stl.export_stl_ascii(trimesh.creation.box(SIDES)).encode()
POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"
NATURES = [
    ("pointer.obj", POINTER, "Git LFS pointer"),
    ("pointer.stl", POINTER, "Git LFS pointer"),
    ("page.obj", b"\n<!DOCTYPE html>\n<html><body>404</body></html>", "an HTML page"),
    ("page.glb", b"<HTML><body>404</body></HTML>", "an HTML page"),
    ("error.ply", b'<?xml version="1.0"?>\n<Error><Code>AccessDenied</Code></Error>', "error page"),
    ("packed.obj", gzip.compress(b"v 0 0 0"), "an archive"),
    ("packed.stl", b"PK\x03\x04rest", "an archive"),
    ("picture.off", b"\x89PNG\r\n", "a picture"),
    ("cut.stl", BINARY[:-60], "cut off: it announces 12 triangles and holds 10"),
    ("cut_text.stl", ASCII[: len(ASCII) // 2], "cut off"),
    ("cut_facet.stl", ASCII[: ASCII.rindex(b"facet normal")], "cut off"),
]


@pytest.mark.parametrize(("name", "content", "defect"), NATURES, ids=[name for name, *_ in NATURES])
def test_files_are_named_for_what_they_are(name, content, defect, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(MeshError, match=defect):
        import_mesh(tmp_path / name, ImportConfig())


@pytest.mark.parametrize(
    "content", [BINARY, BINARY + b"\0" * 7, ASCII, b"solid of a binary file".ljust(80) + BINARY[80:]]
)
def test_whole_files_pass(content, tmp_path):
    (tmp_path / "mesh.stl").write_bytes(content)
    assert len(import_mesh(tmp_path / "mesh.stl", ImportConfig()).faces) == 12


def test_broken_links_are_reported(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "meshes"
    folder.mkdir()
    box(folder / "box.stl")
    (folder / "gone.stl").symlink_to(tmp_path / "nowhere.stl")
    assert main(["build", "--meshes", str(folder), "--out", str(tmp_path / "set")]) == 1
    assert "gone.stl: is a link to" in capsys.readouterr().err
    manifest = json.loads((tmp_path / "set" / "manifest.json").read_bytes())
    assert [item["file"] for item in manifest["refused"]] == ["gone.stl"]
    assert main(["check", str(folder)]) == 1
    assert "gone.stl: is a link to" in capsys.readouterr().out
