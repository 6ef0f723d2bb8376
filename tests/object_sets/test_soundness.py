"""One definition of a sound surface: what a build takes, a check and the tables of the encodings take too."""

import numpy as np
import pytest
import trimesh
from box_bodies import Box, cube, write

import object_sets
from object_sets import MeshError
from object_sets.importing import ImportConfig, import_mesh
from object_sets.mass import mass_properties
from object_sets.soundness import MARGIN, MERGE_DISTANCE, surface
from tactile_kit.shape import MeshTable

OVERLAPPING = 27  # as in the decomposed models of grasp data sets


def heap(seed, count=OVERLAPPING):
    """Convex bodies that overlap at random: their union is full of narrow triangles."""
    generator = np.random.default_rng(seed)
    bodies = []
    for _ in range(count):
        center = generator.uniform(-0.02, 0.02, 3)
        points = center + generator.uniform(-0.015, 0.015, (generator.integers(6, 30), 3))
        bodies.append(trimesh.convex.convex_hull(points))
    return trimesh.util.concatenate(bodies)


def lowest(vertices, faces):
    corners = vertices[faces]
    edges = np.roll(corners, -1, axis=1) - corners
    return (
        np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / np.linalg.norm(edges, axis=2).max(axis=1)
    ).min()


@pytest.mark.parametrize("seed", [14, 39, 108])
def test_unions_are_free_of_slivers(seed, tmp_path):
    """These seeds left triangles lower than 1e-8 m; the solid stays what it was, and smaller sizes are sound too."""
    heap(seed).export(tmp_path / "heap.obj")
    mesh = import_mesh(tmp_path / "heap.obj", ImportConfig())
    assert any("removed slivers" in repair for repair in mesh.repairs)
    assert lowest(mesh.vertices, mesh.faces) > MARGIN * MERGE_DISTANCE
    for factor in (1.0, 0.15):
        table = MeshTable.from_meshes([(mesh.vertices * factor, mesh.faces)])
        assert table.offsets[-1] == len(mesh.faces)
    inside = sum(body.contains(probes(seed)) for body in heap(seed).split()) > 0
    shift = (heap(seed).bounds.mean(axis=0))[None]
    moved = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert (moved.contains(probes(seed) - shift) == inside).mean() > 0.995


def probes(seed):
    return np.random.default_rng(seed + 1).uniform(-0.035, 0.035, (2000, 3))


def test_built_checked_and_encoded(tmp_path, monkeypatch):
    monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / "cache"))
    (tmp_path / "meshes").mkdir()
    heap(14, 6).export(tmp_path / "meshes" / "heap.obj")
    write(tmp_path / "meshes" / "along_an_edge.stl", [cube(0, 2), Box((2, 2, 0), (4, 4, 2))])
    settings = {"extent": (0.045, 0.09), "scales": 3, "coacd_threshold": 0.2}
    path = object_sets.build(tmp_path / "set", meshes=tmp_path / "meshes", **settings)
    assert object_sets.verify(path) == 2
    built = object_sets.load(path)
    assert len(MeshTable.from_meshes([(item.vertices, item.faces) for item in built], built.names)) == 6


def test_errors_name_the_object():
    box = trimesh.creation.box((0.05, 0.05, 0.05))
    with pytest.raises(MeshError, match=r"^mug: not watertight, 3 edges"):
        MeshTable.from_meshes([(box.vertices, box.faces), (box.vertices, box.faces[1:])], ["box", "mug"])


def test_touching_bodies_stay_apart(tmp_path):
    """Two cubes along one edge: closed by their own indices, branched if vertices in one place were merged."""
    mesh = import_mesh(write(tmp_path / "mesh.obj", [cube(0, 2), Box((2, 2, 0), (4, 4, 2))]), ImportConfig())
    found = surface(mesh.vertices, mesh.faces, "cubes")
    assert len(found.vertices) == 16 and len(np.unique(found.vertices, axis=0)) == 14
    assert mass_properties(found.vertices, found.faces).volume == pytest.approx(16e-6, rel=1e-6)


def test_what_ships_is_sound():
    for item in object_sets.load("all"):
        assert len(surface(item.vertices, item.faces, item.name).faces) == len(item.faces)
