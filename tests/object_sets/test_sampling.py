"""Random families: sound, within their extents, the same from the same seed, and held when that is asked for."""

from importlib.metadata import entry_points

import numpy as np
import pytest

import object_sets
from object_sets import ObjectSetError, UnknownObjectError, sample, verify
from object_sets.cli import main
from object_sets.families import FAMILIES
from object_sets.sampling import GROUP, grasp_check

COUNTS = {"prism": 4, "superquadric": 3, "csg": 1}
LOW, HIGH = 0.045, 0.09


@pytest.fixture(scope="module")
def sets(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTILE_KIT_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield {
            family: sample(tmp_path_factory.mktemp(family), family, count, seed=7).parent
            for family, count in COUNTS.items()
        }


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("family", FAMILIES)
def test_sound_and_within_the_extents(family, sets):
    assert verify(sets[family]) == COUNTS[family]
    items = object_sets.load(sets[family])
    extents = np.array([item.extents for item in items])
    assert (extents > LOW - 1e-6).all() and (extents < HIGH + 1e-6).all()
    assert len(np.unique(extents.round(6))) == extents.size
    assert len({item.digest for item in items}) == len(items)
    assert all(item.volume > 0.1 * item.extents.prod() for item in items)
    assert all(len(item.parts) <= 8 for item in items)


def test_families_differ_in_kind(sets):
    """CSG bodies are never convex; of the others some are and some are not."""
    assert not any(item.convex for item in object_sets.load(sets["csg"]))
    prisms = object_sets.load(sets["prism"])
    assert {item.convex for item in prisms} == {True, False}
    for item in (
        prisms
    ):  # a prism's side faces stand upright: few normals point anywhere but up, down, sideways, or 45°
        a, b, c = item.vertices[item.faces].transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        areas = np.linalg.norm(normals, axis=1)
        upright = np.abs(normals[:, 2]) / areas
        straight = (upright < 0.01) | (upright > 0.99)
        assert areas[straight].sum() > 0.85 * areas.sum()


def test_superellipsoids_meet_their_equation():
    from object_sets.csg import to_mesh
    from object_sets.families.superquadric import superellipsoid

    for exponents in ((1.0, 1.0), (0.3, 2.2), (2.4, 0.2)):
        extents = np.array([0.05, 0.06, 0.08])
        vertices, _ = to_mesh(superellipsoid(np.array(exponents), extents))
        x, y, z = np.abs(2.0 * vertices / extents).T
        e, f = exponents
        value = (x ** (2 / f) + y ** (2 / f)) ** (f / e) + z ** (2 / e)
        assert np.allclose(value, 1.0, atol=2e-4)


@pytest.mark.parametrize("family", FAMILIES)
def test_same_seed_same_bytes(family, sets, tmp_path, monkeypatch):
    monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / "cache"))  # CoACD runs again
    again = sample(tmp_path / "again", family, COUNTS[family], seed=7, jobs=2).parent
    assert content(again) == content(sets[family])


def test_longer_set_begins_with_the_shorter(sets, tmp_path):
    short = sample(tmp_path / "short", "superquadric", 2, seed=7).parent
    for file in short.glob("*.npz"):
        assert file.read_bytes() == (sets["superquadric"] / file.name).read_bytes()
    other = sample(tmp_path / "other", "superquadric", 2, seed=8).parent
    assert not set(content(other).values()) & set(content(sets["superquadric"]).values())


def test_drawn_again_until_graspable(tmp_path):
    """A check that wants tall things: every object passes it, and the source says which draw it was."""

    def tall(thing, seed):
        assert seed == 3
        return thing.extents[2] > 0.065

    path = sample(tmp_path, "superquadric", 3, seed=3, graspable=tall)
    items = object_sets.load(path)
    assert all(item.extents[2] > 0.065 for item in items)
    assert any("draw 0" not in item.source for item in items)
    assert all("tall" in item.source for item in items)


def test_never_graspable_is_refused(tmp_path):
    with pytest.raises(ObjectSetError, match="none of 3 draws is graspable"):
        sample(tmp_path / "out", "prism", 1, draws=3, graspable=lambda thing, seed: False)


def test_hand_holds_what_is_sampled(tmp_path):
    """The check that this distribution registers, in the real simulation."""
    (point,) = entry_points(group=GROUP)
    holds = grasp_check(point.name)
    assert holds.__module__ == "tactile_kit.simulation.graspable"
    items = object_sets.load(sample(tmp_path, "superquadric", 1, seed=1, graspable=holds))
    assert all(holds(item, seed=5) for item in items)
    assert not holds(items[0].with_extents(0.003), seed=5)  # far too small for this hand


def test_command(tmp_path, capsys, sets):
    arguments = ["sample", "--family", "superquadric", "--count", "2", "--out", str(tmp_path)]
    assert main([*arguments, "--seed", "7", "--jobs", "1"]) == 0
    assert "2 objects, 0 refused" in capsys.readouterr().out
    file = "superquadric_0001.npz"
    assert (tmp_path / file).read_bytes() == (sets["superquadric"] / file).read_bytes()
    assert main([*arguments, "--graspable", "--grasp-check", "none-such"]) == 1
    assert "is not installed" in capsys.readouterr().err
    assert main([*arguments, "--grasp-check", "dlr_hand"]) == 1


def test_without_a_grasp_check(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("object_sets.sampling.entry_points", lambda group: ())
    assert main(["sample", "--family", "prism", "--graspable", "--out", str(tmp_path / "out")]) == 1
    assert "no grasp check is installed" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_grasp_checks_of_others(tmp_path, monkeypatch):
    """A second installed package offers one that doesn't load."""
    about = tmp_path / "mine-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[{GROUP}]\nmine = no_such_module:check\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(ObjectSetError, match="several grasp checks are installed, name one: dlr_hand, mine"):
        grasp_check()
    with pytest.raises(ObjectSetError, match=r"'mine' \(no_such_module:check\) can't be loaded"):
        grasp_check("mine")
    with pytest.raises(ObjectSetError, match="'dlr_hadn' is not installed; nearest valid name: 'dlr_hand'"):
        grasp_check("dlr_hadn")


@pytest.mark.parametrize(
    ("arguments", "settings", "error"),
    [
        (("prysm", 1), {}, UnknownObjectError),
        (("prism", 0), {}, ObjectSetError),
        (("prism", 1), {"extent": (0.09, 0.045)}, ObjectSetError),
        (("prism", 1), {"jobs": 0}, ObjectSetError),
        (("prism", 1), {"draws": 0}, ObjectSetError),
        (("prism", 1), {"max_parts": 0}, ObjectSetError),
    ],
)
def test_bad_arguments(tmp_path, arguments, settings, error):
    with pytest.raises(error):
        sample(tmp_path / "out", *arguments, **settings)
    assert not (tmp_path / "out").exists()
