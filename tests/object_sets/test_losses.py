"""What is lost on the way to an object is said: by simplification, and by convex parts."""

import json
import re

import numpy as np
import pytest
import trimesh

from object_sets.cli import main
from object_sets.csg import box, to_mesh
from object_sets.importing import ImportConfig, import_mesh
from object_sets.mass import mass_properties


def test_what_simplifying_changed_is_said(tmp_path):
    """Volume and inertia, with their sign, as measured here from the two meshes."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.03)
    ball.apply_scale((1.0, 0.8, 0.6))
    path = tmp_path / "ball.ply"
    ball.export(path)
    whole, simple = import_mesh(path, ImportConfig(max_faces=30000)), import_mesh(path, ImportConfig())
    old, new = (mass_properties(mesh.vertices, mesh.faces) for mesh in (whole, simple))
    (said,) = simple.repairs
    share = 100 * (new.volume / old.volume - 1)
    moments = 100 * (np.linalg.eigvalsh(new.inertia) / np.linalg.eigvalsh(old.inertia) - 1)
    assert f"volume, and mass at a density, by {share:+.2g} %" in said and abs(share) > 0.1
    assert f"inertia at a mass by up to {moments[np.abs(moments).argmax()]:+.2g} %" in said


def test_rough_parts_are_said_and_can_be_refused(tmp_path, monkeypatch, capsys):
    """A tray in one part, which fills its hollow."""
    monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / "cache"))
    (tmp_path / "meshes").mkdir()
    tray = box((0.06, 0.06, 0.02)) - box((0.05, 0.05, 0.012), (0.0, 0.0, 0.01))
    trimesh.Trimesh(*to_mesh(tray), process=False).export(tmp_path / "meshes" / "tray.stl")
    command = ["build", "--meshes", str(tmp_path / "meshes"), "--out", str(tmp_path / "set")]
    command += ["--max-parts", "1", "--coacd-threshold", "1"]
    assert main(command) == 0
    entry = json.loads((tmp_path / "set" / "manifest.json").read_bytes())["objects"][0]
    told = f"{100 * entry['errors']['symmetric_difference']:.2g} % of its volume"
    text = capsys.readouterr()
    assert entry["errors"]["symmetric_difference"] == pytest.approx(15 / 57, rel=1e-6)
    assert f"convex parts: {told} (the parts fill +26 %), 6 mm at worst (tray)" in text.out
    assert "warning tray: its 1 convex parts differ from it by 26 %" in text.err
    assert main([*command, "--max-part-error", "0.1"]) == 1
    assert re.search(r"tray.stl: its . convex parts differ .* allowed are 10;", capsys.readouterr().err)
    assert main([*command, "--max-part-error", "1.5"]) == 1
    assert "max_part_error = 1.5" in capsys.readouterr().err
