"""What is no solid becomes one on request, and is said to have: how far the surface moved is measured."""

import re

import numpy as np
import pytest
import trimesh

from object_sets import MeshError
from object_sets.cli import main
from object_sets.importing import ImportConfig, import_mesh
from object_sets.mass import mass_properties


def bowl():
    """Half a sphere of no thickness, 6 cm wide."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.03)
    ball.update_faces(ball.triangles_center[:, 2] < 0)
    return ball


def walled():
    """A box with an inner wall from edge to edge, and a flap that stands on it."""
    mesh = trimesh.creation.box((0.06, 0.05, 0.07))
    vertices = np.vstack([mesh.vertices, [0.045, 0.0, 0.0]])
    flap = [[4, 5, 8]]
    return trimesh.Trimesh(vertices, np.vstack([mesh.faces, [[0, 1, 7], [0, 7, 6]], flap]), process=False)


# the mesh; cm^3 of the solid it becomes, and by how much that may be off
CASES = {
    # the cells are 1/64 of the size, walls two cells thick: 2 pi r^2 times the thickness
    "bowl": (bowl, 2 * np.pi * 3**2 * (2 / 64 * 6), 0.2),
    # the flap: half of 7 cm times 2.9 cm, two cells thick
    "walled": (walled, 6 * 5 * 7 + 7 * 2.9 / 2 * (2 / 64 * 7.5), 0.02),
}


def deviation(mesh):
    (said,) = [repair for repair in mesh.repairs if repair.startswith("remeshed")]
    return [
        float(number) / 100 for number in re.findall(r"([\d.]+) % of its size at most, ([\d.]+) %", said)[0]
    ]


@pytest.mark.parametrize("name", CASES)
def test_remeshed(name, tmp_path):
    make, volume, tolerance = CASES[name]
    original = make()
    original.export(tmp_path / "mesh.ply")
    with pytest.raises(MeshError, match="have it remeshed"):
        import_mesh(tmp_path / "mesh.ply", ImportConfig())
    mesh = import_mesh(tmp_path / "mesh.ply", ImportConfig(remesh=True, center="origin"))
    assert 1e6 * mass_properties(mesh.vertices, mesh.faces).volume == pytest.approx(volume, rel=tolerance)
    most, mean = deviation(mesh)
    assert 0 < mean < most < 3 / 64
    assert np.allclose(np.ptp(mesh.vertices, axis=0), original.extents, atol=0.01 * original.extents.max())
    # What is said is true, but for the simplification, which says its own share.
    points, _ = trimesh.sample.sample_surface(trimesh.Trimesh(mesh.vertices, mesh.faces), 500, seed=1)
    moved = trimesh.proximity.closest_point(original, points)[1] / original.extents.max()
    assert moved.max() < most + 0.01


def test_a_sound_file_is_left_alone(tmp_path):
    trimesh.creation.box((0.06, 0.05, 0.07)).export(tmp_path / "mesh.stl")
    assert import_mesh(tmp_path / "mesh.stl", ImportConfig(remesh=True)).repairs == ()


def test_on_the_command_line(tmp_path, capsys):
    bowl().export(tmp_path / "bowl.stl")
    assert main(["check", str(tmp_path / "bowl.stl"), "--remesh"]) == 0
    assert re.search(r"remeshed in cells of 1.56 % of its size, since it is open", capsys.readouterr().out)
