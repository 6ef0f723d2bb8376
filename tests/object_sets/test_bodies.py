"""Several bodies in one file: which are solid, which are cavities, whatever their order and orientation."""

import numpy as np
import pytest
import trimesh
from box_bodies import CM, Box, cube, inverted, write
from hypothesis import given, settings
from hypothesis import strategies as st

from object_sets import MeshError
from object_sets.importing import ImportConfig, import_mesh
from object_sets.mass import mass_properties

# (bodies, cm^3, cavities): right side out; inside out as a whole they are the same
SOLIDS = {
    "overlapping": ([cube(0, 3), Box((1, 1, 1), (6, 2, 2))], 30, 0),
    "handle on top": ([Box((0, 0, 0), (2, 2, 5)), Box((-1, -1, 5), (4, 3, 7))], 20 + 40, 0),
    "hollow": ([cube(0, 6), cube(1, 5, False)], 152, 1),
    "hollow with a pillar": ([cube(0, 6), cube(1, 5, False), Box((2, 2, 0), (3, 3, 6))], 156, 1),
    "hollow, a pillar in its walls": ([cube(0, 8), cube(2, 6, False), Box((3, 3, 1), (4, 4, 7))], 452, 1),
    "two cavities": ([cube(0, 6), cube(1, 2, False), Box((3, 1, 1), (5, 5, 5), False)], 216 - 33, 2),
    "body in a body": ([cube(0, 6), cube(1, 5)], 216, 0),
    "hollow body in a solid one": (
        [cube(0, 3), Box((2, 0, 0), (8, 6, 6)), Box((3, 1, 1), (7, 5, 5), False)],
        0,
        1,
    ),
    "stack": ([Box((0, 0, z), (2, 2, z + 2)) for z in (0, 2, 4)], 24, 0),
    "along an edge": ([cube(0, 2), Box((2, 2, 0), (4, 4, 2))], 16, 0),
    "wall within a wall": ([cube(0, 4), Box((4, 1, 1), (6, 3, 3))], 72, 0),
    "two hollow boxes": (
        [
            Box((0, 0, 0), (4, 4, 4)),
            cube(1, 3, False),
            Box((4, 0, 0), (8, 4, 4)),
            Box((5, 1, 1), (7, 3, 3), False),
        ],
        128 - 16,
        2,
    ),
}
SOLIDS["hollow body in a solid one"] = (SOLIDS["hollow body in a solid one"][0], 27 + 216 - 9 - 64, 1)


def read(path):
    mesh = import_mesh(path, ImportConfig())
    return 1e6 * mass_properties(mesh.vertices, mesh.faces).volume, mesh


@pytest.mark.parametrize("ending", ["obj", "stl"])
@pytest.mark.parametrize("outward", [True, False], ids=["outward", "inward"])
@pytest.mark.parametrize("name", SOLIDS)
def test_volume(name, outward, ending, tmp_path):
    """In three orders of bodies and faces."""
    boxes, volume, cavities = SOLIDS[name]
    boxes = boxes if outward else inverted(boxes)
    for seed in (None, 1, 2):
        ordered = (
            boxes if seed is None else [boxes[i] for i in np.random.default_rng(seed).permutation(len(boxes))]
        )
        found, mesh = read(write(tmp_path / f"mesh.{ending}", ordered, seed))
        assert found == pytest.approx(volume, rel=1e-6), mesh.repairs
        assert any("inside-out" in repair for repair in mesh.repairs) == (not outward)
        assert sum("kept" in repair for repair in mesh.repairs) == min(cavities, 1)


@pytest.mark.parametrize("turned", [0, 1])
def test_one_body_inside_out(turned, tmp_path):
    """Of two that overlap, or touch: it is no cavity, since it does not lie in the other."""
    for name in ("overlapping", "handle on top", "stack"):
        boxes, volume, _ = SOLIDS[name]
        boxes = (
            [*inverted(boxes[:1]), *boxes[1:]] if turned else [*boxes[:1], *inverted(boxes[1:2]), *boxes[2:]]
        )
        for order in (boxes, boxes[::-1]):
            found, mesh = read(write(tmp_path / "mesh.obj", order))
            assert found == pytest.approx(volume, rel=1e-6)
            assert "turned 1 inside-out body" in mesh.repairs


UNDECIDED = {
    "cavity in a cavity": [cube(0, 8), cube(1, 7, False), cube(3, 5, False)],
    "cavity of two nested": [cube(0, 8), cube(1, 7), cube(2, 5, False)],
    "cavity of two overlapping": [cube(0, 4), Box((2, 0, 0), (6, 4, 4)), Box((1, 1, 1), (5, 3, 3), False)],
}


@pytest.mark.parametrize("outward", [True, False])
@pytest.mark.parametrize("name", UNDECIDED)
def test_two_readings_are_refused(name, outward, tmp_path):
    boxes = UNDECIDED[name] if outward else inverted(UNDECIDED[name])
    for order in (boxes, boxes[::-1]):
        with pytest.raises(MeshError, match=r"can be read in two ways: a body about \(.*\) .* or "):
            read(write(tmp_path / "mesh.obj", order))


@pytest.mark.parametrize("outward", [True, False])
def test_a_loose_body_in_a_cavity_is_refused(outward, tmp_path):
    """It would rattle; the solid it lies in is no reason to take it for a part of it, nor to lose it."""
    boxes = [cube(0, 6), cube(1, 5, False), cube(2, 4)]
    with pytest.raises(MeshError, match=r"bodies that don't touch \(2 bodies, 1 of them apart\)"):
        read(write(tmp_path / "mesh.obj", boxes if outward else inverted(boxes)))


CORNER = st.tuples(*[st.integers(0, 4)] * 3)


@st.composite
def some_boxes(draw):
    boxes = []
    for _ in range(draw(st.integers(1, 5))):
        low = draw(CORNER)
        sides = draw(st.tuples(*[st.integers(1, 4)] * 3))
        boxes.append(Box(low, tuple(a + b for a, b in zip(low, sides))))
    return boxes


def cells(boxes):
    """(9, 9, 9) bool: the centimetre cells that boxes fill."""
    grid = np.zeros((9, 9, 9), bool)
    for box in boxes:
        grid[tuple(slice(a, b) for a, b in zip(box.low, box.high))] = True
    return grid


@settings(max_examples=60, deadline=None)
@given(some_boxes(), st.booleans(), st.integers(0, 2**32 - 1))
def test_any_boxes_are_their_union(tmp_path_factory, boxes, outward, seed):
    """With indices of their own: what fills a cell fills the solid; apart they are refused. Holes stay holes."""
    path = tmp_path_factory.mktemp("boxes") / "mesh.obj"
    try:
        found, mesh = read(write(path, boxes if outward else inverted(boxes), seed))
    except MeshError as error:
        assert "don't touch" in error.defect
        return
    filled = cells(boxes)
    assert found == pytest.approx(filled.sum(), rel=1e-6)
    occupied = np.argwhere(filled)
    assert np.allclose(np.ptp(mesh.vertices, axis=0), (np.ptp(occupied, axis=0) + 1) * CM, atol=1e-6)


@settings(max_examples=60, deadline=None)
@given(some_boxes(), st.lists(st.booleans(), min_size=5, max_size=5), st.integers(0, 2**32 - 1))
def test_order_and_inversion_change_nothing(tmp_path_factory, boxes, outward, seed):
    """Any orientations: whatever the reading is, it is that of the shuffled and of the inverted file."""
    boxes = [box._replace(outward=side) for box, side in zip(boxes, outward)]
    path = tmp_path_factory.mktemp("boxes") / "mesh.obj"

    def outcome(some, seed=None):
        try:
            return pytest.approx(read(write(path, some, seed))[0], rel=1e-6)
        except MeshError as error:
            return error.defect.split("(")[0]

    first = outcome(boxes)
    assert outcome(boxes, seed) == first
    assert outcome(boxes[::-1], seed) == first
    assert outcome(inverted(boxes)) == first


def test_doubled_surfaces_are_one(tmp_path):
    """A body listed twice, or with a second face on the back of each, as for rendering from both sides."""
    for copies in ([cube(0, 3), cube(0, 3)], [cube(0, 3), cube(0, 3, False)]):
        for ending in ("obj", "stl"):
            found, mesh = read(write(tmp_path / f"mesh.{ending}", copies))
            assert found == pytest.approx(27, rel=1e-6)
            assert "dropped 12 repeated faces" in mesh.repairs


@pytest.mark.parametrize("ending", ["obj", "stl", "ply", "off"])
def test_t_junctions(ending, tmp_path):
    """A side cut in three while its neighbours are whole: corners lie within edges, on one edge and on two."""
    mesh = cube(0, 6).mesh()
    vertices = np.vstack([mesh.vertices, mesh.vertices[[0, 0, 1]] * 0])
    a, b, c = mesh.faces[0]
    vertices[8] = vertices[a] + (vertices[b] - vertices[a]) / 3
    vertices[9] = vertices[a] + (vertices[b] - vertices[a]) * 2 / 3
    vertices[10] = (vertices[b] + vertices[c]) / 2
    pieces = [(a, 8, c), (8, 9, c), (9, b, 10), (9, 10, c)]
    trimesh.Trimesh(vertices, [*mesh.faces[1:], *pieces], process=False).export(tmp_path / f"mesh.{ending}")
    found, result = read(tmp_path / f"mesh.{ending}")
    assert found == pytest.approx(216, rel=1e-6)
    assert "split 2 edges at vertices of their neighbours" in result.repairs


def test_a_cavity_with_one_face_turned(tmp_path):
    """The face is turned to its neighbours, not they to it, wherever it stands in the file."""
    for number in range(12):
        meshes = [cube(0, 6).mesh(), cube(1, 5, False).mesh()]
        faces = meshes[1].faces.copy()
        faces[0] = faces[0, ::-1]
        meshes[1].faces = np.roll(faces, number, axis=0)
        trimesh.util.concatenate(meshes).export(tmp_path / "mesh.ply")
        assert read(tmp_path / "mesh.ply")[0] == pytest.approx(152, rel=1e-6)


def test_solids_of_one_stl_that_share_a_face(tmp_path):
    """Listed as two solids or as one heap of triangles, cut by the same diagonal or by the other."""
    left, right = cube(0, 3).mesh(), Box((3, 0, 0), (6, 3, 3)).mesh()
    mirrored = right.copy().apply_transform(np.diag([1.0, -1.0, 1.0, 1.0])).apply_translation((0, 3 * CM, 0))
    for other in (right, mirrored):
        text = "".join(trimesh.exchange.stl.export_stl_ascii(mesh) + "\n" for mesh in (left, other))
        (tmp_path / "solids.stl").write_text(text)
        trimesh.util.concatenate([left, other]).export(tmp_path / "heap.stl")
        for name in ("solids.stl", "heap.stl"):
            assert read(tmp_path / name)[0] == pytest.approx(54, rel=1e-6)


@settings(max_examples=60, deadline=None)
@given(some_boxes(), st.booleans(), st.integers(0, 2**32 - 1))
def test_a_heap_of_triangles_is_the_union_or_refused(tmp_path_factory, boxes, outward, seed):
    """Without indices, bodies whose corners and edges coincide can't always be told apart; then that is said."""
    path = tmp_path_factory.mktemp("boxes") / "mesh.stl"
    try:
        found, _ = read(write(path, boxes if outward else inverted(boxes), seed))
    except MeshError as error:
        assert (
            "don't touch" in error.defect or "more than two faces" in error.defect or "cuts" in error.defect
        )
    else:
        assert found == pytest.approx(cells(boxes).sum(), rel=1e-6)
