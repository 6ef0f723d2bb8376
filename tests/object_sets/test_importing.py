"""Mesh files of all kinds and states: what passes, what is repaired, what is refused and how it is said."""

import numpy as np
import pytest
import trimesh

import object_sets
from object_sets import MeshError, ObjectSetError
from object_sets.cli import main
from object_sets.csg import box, to_manifold, to_mesh
from object_sets.importing import ImportConfig, import_mesh
from object_sets.mass import mass_properties

SIDES = (0.06, 0.05, 0.07)


def cube():
    return trimesh.creation.box(SIDES)


@pytest.fixture
def save(tmp_path):
    def write(mesh, name="mesh.ply"):
        mesh.export(tmp_path / name)
        return tmp_path / name

    return write


def volume(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume


def read_mesh(path, **settings):
    """In this process; what a process of its own adds is tested in test_hostile_files.py."""
    return import_mesh(path, ImportConfig(**settings))


@pytest.mark.parametrize("ending", ["stl", "obj", "ply", "glb", "gltf", "off", "3mf"])
def test_formats(ending, save, tmp_path):
    mesh = cube().apply_translation((1, 2, 3))
    if ending == "3mf":
        mesh.apply_scale(1000.0)  # the one format with a unit, by default the millimetre
    if ending == "gltf":
        for name, data in trimesh.Scene(mesh).export(file_type="gltf").items():
            (tmp_path / name.replace("model", "mesh")).write_bytes(data)
        path = tmp_path / "mesh.gltf"
    else:
        path = save(mesh, f"mesh.{ending}")
    result = read_mesh(path)
    assert result.repairs == ()
    assert np.allclose(np.ptp(result.vertices, axis=0), SIDES, atol=1e-6)
    assert np.allclose(result.vertices.min(axis=0), -result.vertices.max(axis=0), atol=1e-7)
    assert len(result.vertices) == 8 and len(result.faces) == 12


def test_inside_out_is_turned(save):
    mesh = cube()
    mesh.invert()
    result = read_mesh(save(mesh))
    assert volume(result) == pytest.approx(np.prod(SIDES), rel=1e-5)
    assert any("inside-out" in repair for repair in result.repairs)


def test_mixed_winding_is_turned(save):
    mesh = cube()
    mesh.faces[[2, 5, 7]] = mesh.faces[[2, 5, 7], ::-1]
    result = read_mesh(save(mesh))
    assert volume(result) == pytest.approx(np.prod(SIDES), rel=1e-5)
    assert any("turned" in repair for repair in result.repairs)


def test_small_hole_is_closed(save):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    mesh.update_faces(np.arange(len(mesh.faces)) != 100)
    result = read_mesh(save(mesh))
    assert any("closed holes with 3 border edges" in repair for repair in result.repairs)
    assert trimesh.Trimesh(result.vertices, result.faces).is_watertight


def test_repeated_faces_are_dropped(save):
    mesh = cube()
    mesh.faces = np.vstack([mesh.faces, mesh.faces[:2], [[0, 0, 1]]])
    result = read_mesh(save(mesh))
    assert len(result.repairs) == 2 and len(result.faces) == 12


def test_vertices_within_rounding_are_one(tmp_path):
    mesh = cube()
    mesh.unmerge_vertices()
    mesh.vertices += np.random.default_rng(0).uniform(-2e-10, 2e-10, mesh.vertices.shape)
    (tmp_path / "mesh.obj").write_text(trimesh.exchange.obj.export_obj(mesh, digits=12))
    result = read_mesh(tmp_path / "mesh.obj")
    assert result.repairs == ("merged 28 vertices that lay within rounding of others",)
    assert len(result.vertices) == 8 and volume(result) == pytest.approx(np.prod(SIDES), rel=1e-5)


def test_overlapping_bodies_are_united(save):
    both = trimesh.util.concatenate([cube(), cube().apply_translation((0.03, 0.0, 0.0))])
    result = read_mesh(save(both))
    assert volume(result) == pytest.approx(0.09 * 0.05 * 0.07, rel=1e-5)
    assert any("united 2 bodies" in repair for repair in result.repairs)


def test_cavity_is_kept(save):
    hole = trimesh.creation.box((0.02, 0.02, 0.02))
    hole.invert()
    result = read_mesh(save(trimesh.util.concatenate([cube(), hole])))
    assert volume(result) == pytest.approx(np.prod(SIDES) - 0.02**3, rel=1e-5)
    assert any("kept 1 closed cavity" in repair for repair in result.repairs)


def test_dense_mesh_is_simplified(save):
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.03)
    result = read_mesh(save(ball))
    assert len(result.faces) <= 4000 < len(ball.faces)
    assert volume(result) == pytest.approx(ball.volume, rel=0.02)  # 1 % of the size may move
    assert any("simplified 20480 faces" in repair for repair in result.repairs)


def test_extent_scales_all_axes_alike(save):
    path = save(trimesh.creation.box((60, 30, 40)))  # millimetres
    result = read_mesh(path, extent=(0.045, 0.09))
    assert np.allclose(np.ptp(result.vertices, axis=0), (0.09, 0.045, 0.06), atol=1e-6)
    assert any("scaled" in repair for repair in result.repairs)


def wedge():
    """A prism whose bounding box is not centred on its mass, and whose three extents differ."""
    profile = np.array([(0, 0), (0.06, 0), (0, 0.03)])
    vertices = np.vstack([np.column_stack([profile, np.full(3, z)]) for z in (0.0, 0.04)])
    faces = [(0, 2, 1), (3, 4, 5), (0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (2, 0, 3), (2, 3, 5)]
    return trimesh.Trimesh(vertices, faces, process=False)


def test_centers(save):
    path = save(wedge())
    box, mass, own = (read_mesh(path, center=center) for center in ("bounding-box", "mass", "origin"))
    assert np.allclose(box.vertices.min(axis=0), -box.vertices.max(axis=0), atol=1e-8)
    assert np.allclose(mass_properties(mass.vertices, mass.faces).center_of_mass, 0, atol=1e-8)
    assert np.allclose(own.vertices.min(axis=0), 0, atol=1e-8)
    for other in (mass, own):
        shift = other.vertices - box.vertices
        assert np.allclose(shift, shift[0], atol=2e-8) and np.abs(shift[0]).max() > 0.005


TURN = trimesh.transformations.euler_matrix(0.5, 0.9, -0.4)


def test_alignment_to_the_smallest_box(save):
    result = read_mesh(save(cube().apply_transform(TURN)), alignment="box")
    assert np.allclose(np.ptp(result.vertices, axis=0), sorted(SIDES, reverse=True), atol=1e-6)
    assert volume(result) == pytest.approx(np.prod(SIDES), rel=1e-6)


def test_alignment_to_the_principal_axes(save):
    """The inertia becomes diagonal, smallest moment first, from whatever pose; a mirror image would show."""
    poses = [np.eye(4), TURN, TURN @ TURN]
    results = [read_mesh(save(wedge().apply_transform(pose)), alignment="inertia") for pose in poses]
    for result in results:
        inertia = mass_properties(result.vertices, result.faces).inertia
        assert np.allclose(inertia, np.diag(np.diag(inertia)), atol=1e-9)
        assert (np.diff(np.diag(inertia)) > 0).all()
        assert volume(result) == pytest.approx(0.5 * 0.06 * 0.03 * 0.04, rel=1e-5)


def test_alignment_leaves_what_has_no_axes(save):
    """All axes of a cube are principal: it stays as it is; a rod turns about its own axis only as it must."""
    box = trimesh.creation.box((0.05, 0.05, 0.05))
    assert np.allclose(np.ptp(read_mesh(save(box), alignment="inertia").vertices, axis=0), 0.05, atol=1e-7)
    rod = trimesh.creation.box((0.03, 0.03, 0.09))
    result = read_mesh(save(rod), alignment="inertia")
    assert np.allclose(np.ptp(result.vertices, axis=0), (0.09, 0.03, 0.03), atol=1e-7)


def test_y_up(save):
    result = read_mesh(save(wedge()), alignment="y-up", center="origin")
    assert np.allclose(np.ptp(result.vertices, axis=0), (0.06, 0.04, 0.03), atol=1e-6)
    assert result.vertices[:, 2].min() == pytest.approx(0, abs=1e-7)  # what was down in y is down in z
    assert volume(result) == pytest.approx(0.5 * 0.06 * 0.03 * 0.04, rel=1e-5)


def test_limit_of_faces(save):
    path = save(trimesh.creation.icosphere(subdivisions=4, radius=0.03))
    assert len(read_mesh(path, max_faces=6000).faces) == 5120
    assert len(read_mesh(path, max_faces=2000).faces) <= 2000
    with pytest.raises(MeshError, match=r"has 5120 faces, and .* simplify it to at most 20"):
        read_mesh(path, max_faces=20)


def test_quads(tmp_path):
    lines = [f"v {x} {y} {z}" for x in (0, 0.05) for y in (0, 0.06) for z in (0, 0.07)]
    faces = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    (tmp_path / "quads.obj").write_text("\n".join([*lines, *(f"f {face}" for face in faces)]) + "\n")
    result = read_mesh(tmp_path / "quads.obj")
    assert len(result.faces) == 12 and volume(result) == pytest.approx(0.05 * 0.06 * 0.07, rel=1e-6)


def _open():
    mesh = cube()
    mesh.update_faces(np.arange(12) >= 6)
    return mesh


def _flat():
    return trimesh.creation.box((0.06, 0.06, 1e-7))


def _apart():
    return trimesh.util.concatenate([cube(), cube().apply_translation((0.1, 0, 0))])


def _nan():
    mesh = cube()
    mesh.vertices[3] = np.nan
    return mesh


def _crossed():
    """A tube bent back through itself: closed, oriented, and twice inside where it crosses."""
    angle = np.linspace(0, 3 * np.pi, 40)
    path = 0.03 * np.column_stack([np.sin(angle), np.sin(2 * angle), 0.02 * angle])
    ring = np.linspace(0, 2 * np.pi, 9)[:-1]
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent, [0, 0, 1])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, tangent)
    points = path[:, None] + 0.008 * (
        np.cos(ring)[:, None] * side[:, None] + np.sin(ring)[:, None] * up[:, None]
    )
    faces = []
    for i in range(39):
        for j in range(8):
            a, b, c, d = 8 * i + j, 8 * i + (j + 1) % 8, 8 * (i + 1) + (j + 1) % 8, 8 * (i + 1) + j
            faces += [(a, b, c), (a, c, d)]
    faces += [(0, j + 1, j) for j in range(1, 7)] + [(312, 312 + j, 312 + j + 1) for j in range(1, 7)]
    return trimesh.Trimesh(points.reshape(-1, 3), faces, process=False)


def _point():
    mesh = cube()
    mesh.vertices[:] = 0.01
    return mesh


def _one_sided():
    """Klein's bottle: every edge has two faces, yet no side is the outer one."""
    rows, columns = 24, 12
    u, v = np.meshgrid(
        2 * np.pi * np.arange(rows) / rows, 2 * np.pi * (np.arange(columns) + 0.5) / columns, indexing="ij"
    )
    radius = 2 + np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    height = np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)
    points = 0.015 * np.stack([radius * np.cos(u), radius * np.sin(u), height], axis=-1)
    number = np.arange(rows * columns).reshape(rows, columns)
    number = np.vstack([number, number[0, ::-1]])  # glued the wrong way round
    number = np.hstack([number, number[:, :1]])
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return trimesh.Trimesh(points.reshape(-1, 3), faces, process=False)


def _crowd():
    return trimesh.util.concatenate(
        [trimesh.creation.box((0.001, 0.001, 0.001)).apply_translation((0.002 * i, 0, 0)) for i in range(200)]
        + [cube().apply_translation((0, 0.1 * i, 0)) for i in range(1, 302)]
    ).apply_scale(0.01)


def _branched():
    """A cube with a fin: two triangles that stand on its surface and bound nothing."""
    mesh = cube()
    tip = np.vstack([mesh.vertices, [0.1, 0.1, 0.1]])
    return trimesh.Trimesh(tip, np.vstack([mesh.faces, [[0, 1, 8], [1, 3, 8]]]), process=False)


def _scrap():
    mesh = cube()
    mesh.update_faces(np.arange(12) < 3)
    return mesh


@pytest.mark.parametrize(
    ("make", "defect"),
    [
        (_open, "open: 6 edges"),
        (_point, "all its vertices are one point"),
        (_one_sided, "no common outside"),
        (_crowd, "consists of 501 bodies; allowed are 500"),
        (_scrap, "has 3 proper triangles"),
        (_flat, "flat"),
        (_apart, "don't touch"),
        (_nan, "not finite"),
        (_crossed, "cuts through itself"),
        (lambda: trimesh.creation.box((60, 50, 70)), "allowed are 0.005 to 0.5 m"),
        (lambda: trimesh.PointCloud(np.random.default_rng(0).random((20, 3))), "no triangles"),
        (_branched, "2 edges belong to more than two faces"),
    ],
)
def test_refused(make, defect, save):
    path = save(make())
    with pytest.raises(MeshError, match=defect) as caught:
        read_mesh(path)
    assert caught.value.file == str(path) and caught.value.remedy in str(caught.value)


def test_broken_files(tmp_path):
    for name, content in (("a.stl", b"not a mesh"), ("b.glb", b"glTF\0\0"), ("c.obj", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(MeshError, match=name):
            read_mesh(tmp_path / name)
    with pytest.raises(MeshError, match="can't be read"):
        read_mesh(tmp_path / "missing.stl")
    with pytest.raises(MeshError, match="unknown ending"):
        read_mesh(tmp_path / "mesh.blend")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / "cache"))
    place = tmp_path / "meshes"
    place.mkdir()
    cube().export(place / "a box.stl")
    _open().export(place / "broken.stl")
    (place / "garbage.obj").write_bytes(b"\xff\xfe")
    l_shape = object_sets.load("all")["l_shape"]
    trimesh.Trimesh(l_shape.vertices, l_shape.faces, process=False).export(place / "ell.ply")
    (place / "notes.txt").write_text("not a mesh, not an error")
    return place


def test_bad_files_never_stop_a_batch(folder, tmp_path, capsys):
    code = main(
        [
            "build",
            "--meshes",
            str(folder),
            "--out",
            str(tmp_path / "set"),
            "--licence",
            "CC0-1.0",
            "--jobs",
            "2",
        ]
    )
    assert code == 1
    text = capsys.readouterr()
    assert "2 objects, 2 refused" in text.out
    last = text.err.splitlines()[-2:]
    assert "broken.stl: is open" in last[0] and "garbage.obj" in last[1]
    built = object_sets.load(tmp_path / "set")
    assert built.names == ("a_box", "ell") and [item.id for item in built] == [0, 1]
    assert built[0].convex and not built[1].convex and len(built[1].parts) == 2
    assert built[0].licence == "CC0-1.0" and built[0].source == "a box.stl"


def test_mesh_set_is_reproducible(folder, tmp_path):
    arguments = {"meshes": folder, "extent": (0.045, 0.09), "scales": 2, "seed": 3}
    first = object_sets.build(tmp_path / "one", **arguments)
    other = object_sets.build(tmp_path / "two", **arguments, jobs=2)
    assert {p.name: p.read_bytes() for p in first.parent.iterdir()} == {
        p.name: p.read_bytes() for p in other.parent.iterdir()
    }


def test_nothing_usable_is_an_error(tmp_path):
    with pytest.raises(ObjectSetError, match="no such folder"):
        object_sets.build(tmp_path / "out", meshes=tmp_path / "none")
    _open().export(tmp_path / "broken.stl")
    with pytest.raises(ObjectSetError, match=r"(?s)no object could be made.*broken\.stl"):
        object_sets.build(tmp_path / "out", meshes=tmp_path)


def bowl():
    """A thin shell with a wide opening: one convex part would fill it."""
    outer = trimesh.creation.icosphere(subdivisions=3, radius=0.04)
    solid = to_manifold(outer.vertices, outer.faces)
    shell = solid - solid.scale((0.93, 0.93, 0.93)) - box((0.1, 0.1, 0.1), (0, 0, 0.07))
    vertices, faces = to_mesh(shell)
    return trimesh.Trimesh(vertices, faces, process=False)


def test_parts_that_do_not_stand_for_the_mesh_are_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / "cache"))
    (tmp_path / "meshes").mkdir()
    bowl().export(tmp_path / "meshes" / "bowl.stl")
    with pytest.raises(ObjectSetError, match=r"bowl\.stl: its 1 convex parts (are up to|differ from it by)"):
        object_sets.build(tmp_path / "out", meshes=tmp_path / "meshes", coacd_threshold=1.0, max_parts=1)
