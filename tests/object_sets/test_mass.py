"""Mass properties against closed forms, Monte-Carlo integration and the rules of scaling."""

import numpy as np
import pytest

import object_sets
from object_sets.csg import box, convex_hull, to_manifold, to_mesh
from object_sets.mass import mass_properties
from object_sets.quality import winding_numbers

ALL = object_sets.load("all")


def raw(solid):
    mesh = solid.to_mesh64()
    return np.asarray(mesh.vert_properties), np.asarray(mesh.tri_verts, dtype=np.int64)


def test_box():
    a, b, c = 0.04, 0.06, 0.09
    volume, center, inertia = mass_properties(*raw(box((a, b, c), (0.3, -0.2, 0.1))))
    assert volume == pytest.approx(a * b * c, rel=1e-12)
    assert np.allclose(center, (0.3, -0.2, 0.1), atol=1e-14)
    assert np.allclose(
        inertia, np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) / 12, rtol=1e-10, atol=1e-16
    )


def test_tetrahedron_with_products_of_inertia():
    volume, center, inertia = mass_properties(*raw(convex_hull([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])))
    assert volume == pytest.approx(1 / 6, rel=1e-12)
    assert np.allclose(center, 0.25)
    # Of the unit corner: <x^2> = 1/10, <x y> = 1/20, about the corner; less the centre's 1/16.
    second = np.full((3, 3), 1 / 20 - 1 / 16) + np.eye(3) * (1 / 10 - 1 / 20)
    assert np.allclose(inertia, np.trace(second) * np.eye(3) - second, atol=1e-14)


def test_body_of_two_boxes():
    """An L by parallel axes."""
    one, other = ((0.02, 0.06, 0.03), (0.01, 0.03, 0)), ((0.04, 0.02, 0.03), (0.04, 0.01, 0))
    volume, center, inertia = mass_properties(*raw(box(*one) + box(*other)))
    masses = [np.prod(one[0]), np.prod(other[0])]
    middle = np.average([one[1], other[1]], axis=0, weights=masses)
    expected = np.zeros((3, 3))
    for m, (size, at) in zip(masses, (one, other)):
        size, d = np.square(size), np.subtract(at, middle)
        expected += m * (np.diag(size.sum() - size) / 12 + d @ d * np.eye(3) - np.outer(d, d))
    assert volume == pytest.approx(sum(masses), rel=1e-12)
    assert np.allclose(center, middle, atol=1e-14)
    assert np.allclose(inertia, expected / sum(masses), rtol=1e-10, atol=1e-16)


@pytest.mark.parametrize("name", ["l_shape", "cut_cube", "emergency_switch", "gear"])
def test_monte_carlo(name):
    item = ALL[name].with_extents((0.05, 0.085, 0.07))
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.5, 0.5, (12000, 3)) * item.extents
    points = points[winding_numbers(points, item.vertices, item.faces) > 0.5]
    assert item.volume == pytest.approx(len(points) / 12000 * np.prod(item.extents), rel=0.05)
    assert np.allclose(item.center_of_mass, points.mean(axis=0), atol=0.001)
    second = np.cov(points.T, bias=True)
    assert np.allclose(
        item.inertia, np.trace(second) * np.eye(3) - second, atol=0.04 * np.trace(item.inertia) / 3
    )


def test_scaling_follows_the_covariance():
    for item in ALL:
        factors = np.array([0.8, 1.3, 1.1])
        other = item.scaled(factors)
        second = np.trace(item.inertia) / 2 * np.eye(3) - item.inertia
        second = np.diag(factors) @ second @ np.diag(factors)
        assert other.volume == pytest.approx(item.volume * factors.prod(), rel=1e-10)
        assert np.allclose(other.center_of_mass, item.center_of_mass * factors, atol=1e-12)
        assert np.allclose(other.inertia, np.trace(second) * np.eye(3) - second, rtol=1e-8, atol=1e-14)


def test_inertia_is_physical():
    for item in ALL:
        a, b, c = np.linalg.eigvalsh(item.inertia)
        assert 0 < a <= b <= c <= a + b
        solid = to_manifold(item.vertices, item.faces)
        assert item.volume == pytest.approx(solid.volume(), rel=1e-9)


def test_open_or_flat_mesh_has_no_mass():
    with pytest.raises(ValueError, match="closed solid"):
        mass_properties(np.eye(3), np.array([[0, 1, 2], [0, 2, 1]]))


def test_large_offset_costs_no_accuracy():
    vertices, faces = to_mesh(box((0.04, 0.05, 0.06)))
    near, far = mass_properties(vertices, faces), mass_properties(vertices + 1000.0, faces)
    assert np.allclose(near.inertia, far.inertia, rtol=1e-6, atol=1e-12)
