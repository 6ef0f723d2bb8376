"""The 16 authored shapes: sound solids, the right sizes, the right properties."""

from itertools import permutations, product

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import object_sets
from object_sets.csg import chamfered_polyhedron, chamfered_prism, extrusion, hull_corners, to_mesh
from object_sets.quality import surface_distance, winding_numbers

ALL = object_sets.load("all")
NONCONVEX = {0, 6, 7, 10, 11, 13, 14, 15}
EXTENTS = {9: (0.08, 0.08, 0.05), 12: (0.0754, 0.0749, 0.0719)}


@pytest.fixture(params=ALL, ids=lambda item: item.name)
def item(request):
    return request.param


def test_names_and_ids_are_the_contract():
    assert ALL.names[:13] == (
        "l_shape", "cut_cube", "pentagon_prism", "cylinder", "hexagonal_prism", "rhombicuboctahedron", "h_profile",
        "plus_prism", "cube", "cuboid", "t_shape", "emergency_switch", "apple",
    )  # fmt: skip
    assert [item.id for item in ALL] == list(range(16))


def test_closed_and_oriented(item):
    edges = np.vstack([item.faces[:, [0, 1]], item.faces[:, [1, 2]], item.faces[:, [2, 0]]])
    directed = {tuple(edge) for edge in edges.tolist()}
    assert len(directed) == len(edges), "an edge is used twice in one direction"
    assert directed == {(b, a) for a, b in directed}, "an edge has no opposite"
    assert len(np.unique(item.faces)) == len(item.vertices)
    assert item.volume > 0, "faces point inward"


def test_encloses_each_point_once_or_not_at_all(item):
    rng = np.random.default_rng(item.id)
    points = rng.uniform(-0.6, 0.6, (60, 3)) * item.extents
    numbers = winding_numbers(points, item.vertices, item.faces)
    assert np.abs(numbers - np.clip(np.round(numbers), 0, 1)).max() < 1e-6
    assert {0, 1} == set(np.round(numbers).astype(int))


def test_centred_and_sized(item):
    assert np.allclose(item.vertices.min(axis=0), -item.vertices.max(axis=0), atol=2e-8)
    if item.id < 13:
        assert np.allclose(item.extents, EXTENTS.get(item.id, (0.0675,) * 3), atol=5e-8)
    assert (item.extents >= 0.045).all() and (item.extents <= 0.09).all()
    assert len(item.faces) < 3000


def test_convex_flag(item):
    ratio = item.volume / ConvexHull(item.vertices).volume
    assert item.convex == (item.id not in NONCONVEX)
    assert ratio > 0.9999 if item.convex else ratio < 0.95
    assert (len(item.parts) == 1) == item.convex


def test_apple_has_its_mass_and_others_none():
    assert {item.id: item.mass for item in ALL if item.mass is not None} == {12: 0.068}


@pytest.mark.parametrize("name", ["cube", "rhombicuboctahedron"])
def test_octahedral_symmetry(name):
    """Goals are the 24 octahedral rotations; a cube that isn't invariant under them would have preferred sides."""
    vertices = ALL[name].vertices
    rotations = [
        np.eye(3)[list(p)] * np.array(s)[:, None]
        for p in permutations(range(3))
        for s in product((1, -1), repeat=3)
    ]
    for rotation in (r for r in rotations if np.linalg.det(r) > 0):
        turned = vertices @ rotation.T
        distance = np.linalg.norm(turned[:, None] - vertices, axis=2).min(axis=1)
        assert distance.max() < 3e-8


def test_chamfered_cube_has_the_closed_form_volume():
    a, c = 0.0675, 0.002
    # Twelve prisms with a triangle c x c as base overlap at the corners. Inclusion-exclusion over the three prisms at
    # a corner: pairwise they share a pyramid of c^3/3, all three share c^3/4.
    expected = a**3 - 12 * a * c**2 / 2 + 8 * (3 * c**3 / 3 - c**3 / 4)
    assert ALL["cube"].volume == pytest.approx(expected, rel=1e-5)


def test_chamfers_cut_two_millimetres_off_each_face():
    cube = ALL["cube"].vertices
    on_top = cube[np.isclose(cube[:, 2], cube[:, 2].max())]
    assert np.allclose(np.ptp(on_top[:, :2], axis=0), 0.0675 - 2 * 0.002, atol=1e-7)


def test_prism_and_polyhedron_chamfers_agree_on_a_box():
    corners = np.array(list(product((-0.03, 0.03), (-0.02, 0.02), (-0.025, 0.025))))
    polygon = [(-0.03, -0.02), (0.03, -0.02), (0.03, 0.02), (-0.03, 0.02)]
    one, other = chamfered_polyhedron(corners, 0.003), chamfered_prism(polygon, 0.05, 0.003)
    assert one.volume() == pytest.approx(other.volume(), rel=1e-6)
    assert surface_distance(to_mesh(one)[0], *to_mesh(other)).max() < 1e-7


def test_chamfered_l_lies_in_the_sharp_l_and_keeps_its_notch():
    item = ALL["l_shape"]
    h = 0.0675 / 2
    sharp = extrusion([(-h, -h), (h, -h), (h, 0), (0, 0), (0, h), (-h, h)], 2 * h)
    assert 0.96 < item.volume / sharp.volume() < 1
    notch = np.array([[0.5 * h, 0.5 * h, 0.0], [0.9 * h, 0.1 * h, 0.5 * h]])
    assert np.allclose(winding_numbers(notch, item.vertices, item.faces), 0, atol=1e-9)


def test_hull_corners_with_a_limit():
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(400, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    few = hull_corners(ball, 32)
    assert len(few) == 32
    assert np.array_equal(np.ptp(few, axis=0), np.ptp(ball, axis=0))
    assert 0.75 < ConvexHull(few).volume / ConvexHull(ball).volume < 1
    with pytest.raises(ValueError, match="limit = 4"):
        hull_corners(ball, 4)
