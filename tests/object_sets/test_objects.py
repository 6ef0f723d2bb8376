"""Objects and sets: finding, scaling, equality, verification of the data."""

import io
import json
import pickle
import shutil
import struct
import subprocess
import sys
import zipfile

import numpy as np
import pytest

import object_sets
from object_sets import DataError, ObjectSetError, ScaleError, UnknownObjectError
from object_sets.sets import DATA
from object_sets.storage import npz_bytes, read_npz, sha256, write_atomic


def test_sets():
    sizes = {name: [item.id for item in object_sets.load(name)] for name in object_sets.SETS}
    assert sizes == {
        "geometric8": list(range(8)),
        "ood": list(range(8, 13)),
        "complex": [13, 14, 15],
        "paper": list(range(13)),
        "all": list(range(16)),
    }


def test_selection_keeps_order_and_drops_duplicates():
    chosen = object_sets.select("cube, ood,0,l_shape,12")
    assert [item.id for item in chosen] == [8, 9, 10, 11, 12, 0]
    assert object_sets.select("geometric8").name == "geometric8"


@pytest.mark.parametrize(
    ("text", "hint"),
    [("geometric", "geometric8"), ("cubee", "cube"), ("8,aple", "apple"), ("16", "ids 0-15"), ("", "valid")],
)
def test_unknown_selection(text, hint):
    with pytest.raises(UnknownObjectError, match=hint):
        object_sets.select(text)


def test_unknown_set_and_member():
    with pytest.raises(UnknownObjectError, match="geometric8"):
        object_sets.load("geometrc8")
    with pytest.raises(UnknownObjectError, match="'cylinder'"):
        object_sets.load("geometric8")["cylindr"]


def test_access():
    paper = object_sets.load("paper")
    assert len(paper) == 13 and paper["apple"] is paper[12] and paper[-1].name == "apple"
    assert paper[2:4].names == ("pentagon_prism", "cylinder")


def test_types_shapes_and_read_only():
    for item in object_sets.load("all"):
        assert item.vertices.dtype == np.float64 and item.faces.dtype == np.int32
        assert all(part.dtype == np.float64 and part.ndim == 2 for part in item.parts)
        for array in (item.vertices, item.faces, *item.parts, item.extents):
            with pytest.raises(ValueError):
                array[0] = 0


def test_scaling():
    item = object_sets.load("all")["h_profile"]
    other = item.with_extents((0.045, 0.06, 0.09))
    assert np.allclose(other.extents, (0.045, 0.06, 0.09))
    assert all(np.allclose(b, a * (other.extents / item.extents)) for a, b in zip(item.parts, other.parts))
    assert other.digest != item.digest and other != item and item.scaled(1) == item
    assert other.name == item.name and other.mass == item.mass and other.convex == item.convex
    assert np.allclose(item.scaled(2).extents, 2 * item.extents)


@pytest.mark.parametrize("factors", [0, -1, (1, 1, 0), (1, 1), (1, np.nan, 1), np.inf, "wide"])
def test_bad_scale(factors):
    with pytest.raises(ScaleError, match="scale factors"):
        object_sets.load("all")["cube"].scaled(factors)


def test_pickle_round_trip():
    item = object_sets.load("all")["t_shape"].scaled((1, 1.2, 0.9))
    assert pickle.loads(pickle.dumps(item)) == item


def test_bad_arrays_are_refused():
    good = object_sets.load("all")["cube"]
    make = lambda v, f: object_sets.Object(0, "x", v, f, (), True, "", "")  # noqa: E731
    with pytest.raises(ObjectSetError, match="not all finite"):
        make(good.vertices * np.nan, good.faces)
    with pytest.raises(ObjectSetError, match="face indices"):
        make(good.vertices, good.faces + len(good.vertices))
    with pytest.raises(ObjectSetError, match="shape"):
        make(good.vertices[:, :2], good.faces)


@pytest.fixture
def copy(tmp_path):
    return shutil.copytree(DATA, tmp_path / "set")


def test_copied_directory_loads(copy):
    assert object_sets.load(copy).objects == object_sets.load("all").objects


def test_altered_array_is_noticed(copy):
    arrays = read_npz((copy / "cube.npz").read_bytes(), "cube.npz")
    (copy / "cube.npz").write_bytes(npz_bytes({**arrays, "vertices": arrays["vertices"] * 1.001}))
    with pytest.raises(DataError, match=r"cube\.npz.*altered"):
        object_sets.load(copy)


def test_missing_file_is_noticed(copy):
    (copy / "apple.npz").unlink()
    with pytest.raises(DataError, match=r"apple\.npz: missing"):
        object_sets.load(copy)


def test_altered_or_foreign_manifest_is_noticed(copy):
    path = copy / "manifest.json"
    content = json.loads(path.read_bytes())
    content["objects"][0]["mass"] = 7.0
    path.write_text(json.dumps(content))
    with pytest.raises(DataError, match="digest"):
        object_sets.load(copy)
    path.write_text(json.dumps({**content, "schema": "object-set/99"}))
    with pytest.raises(DataError, match="object-set/99"):
        object_sets.load(copy)
    path.write_text("{")
    with pytest.raises(DataError, match="no manifest"):
        object_sets.load(copy)


def forged(copy, change, **fields):
    """A manifest with other fields and a digest that fits."""
    path = copy / "manifest.json"
    content = json.loads(path.read_bytes())
    content["objects"][0].update(change)
    content.update(fields)
    del content["digest"]
    text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
    digest = sha256(text.encode())
    path.write_text(json.dumps({**content, "digest": digest}))
    return copy


@pytest.mark.parametrize(
    "change",
    [
        {"file": "../outside.npz"},
        {"file": "/etc/passwd"},
        {"file": "a/b.npz"},
        {"file": "..\\outside.npz"},
        {"file": "C:outside.npz"},
        {"file": ".hidden.npz"},
        {"file": "nul\0.npz"},
        {"name": "../../outside"},
        {"scales": [[1.0, -1.0, 1.0]]},
        {"mass": -0.1},
        {"convexity": "round"},
        {"center": "nowhere"},
        {"further": 1},
    ],
    ids=str,
)
def test_forged_manifest_is_refused(copy, change):
    """A path that climbs out, or values that no build writes, even when all digests fit."""
    with pytest.raises(DataError, match=r"manifest\.json"):
        object_sets.load(forged(copy, change))


def test_forged_manifest_with_honest_fields_loads(copy):
    """The files above are refused for what they change, not for the way they are forged."""
    assert len(object_sets.load(forged(copy, {"source": "elsewhere"}))) == 16


def test_strange_json_is_refused(copy):
    for text in (
        "[" * 100_000,
        '{"digest": 1, "a": NaN}',
        "[]",
        "\x00",
        '{"digest": "x", "schema": "object-set/2"}',
    ):
        (copy / "manifest.json").write_text(text)
        with pytest.raises(DataError, match=r"manifest\.json"):
            object_sets.load(copy)


def test_link_out_of_the_folder_is_refused(copy, tmp_path):
    (copy / "cube.npz").rename(tmp_path / "cube.npz")
    (copy / "cube.npz").symlink_to(tmp_path / "cube.npz")
    with pytest.raises(DataError, match=r"cube\.npz: a link that leaves the set's folder"):
        object_sets.load(copy)


def npy(header, data=b""):
    text = header.encode() + b" " * (-(len(header) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


@pytest.mark.parametrize(
    "entry",
    [
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3), }"),
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 3), }"),
        npy("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", b"\x80\x04N."),
        npy("__import__('os').abort()"),
        b"\x93NUMPY\x09\x00",
        b"",
    ],
)
def test_arrays_that_lie_are_refused(entry):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("vertices.npy", entry)
    with pytest.raises(DataError, match=r"lie\.npz"):
        read_npz(stream.getvalue(), "lie.npz")


def test_zip_bomb_is_refused():
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for index in range(52):
            archive.writestr(f"a{index}.npy", bytes(10 * 2**20))
    with pytest.raises(DataError, match="unpacks to 520 MiB"):
        read_npz(stream.getvalue(), "bomb.npz")


def test_pickled_arrays_are_not_read(tmp_path):
    np.savez(tmp_path / "evil.npz", vertices=np.array([{"a": 1}], dtype=object))
    with pytest.raises(DataError, match="evil"):
        read_npz((tmp_path / "evil.npz").read_bytes(), tmp_path / "evil.npz")


def test_loading_and_help_import_nothing_heavy():
    code = (
        "import sys, object_sets, object_sets.cli; object_sets.load('paper');"
        "bad = {'torch', 'coacd', 'trimesh', 'matplotlib', 'pybullet', 'scipy', 'manifold3d'} & set(sys.modules);"
        "sys.exit(f'imported {bad}' if bad else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_write_that_fails_leaves_nothing_behind(tmp_path):
    (tmp_path / "taken").mkdir()
    with pytest.raises(OSError, match="taken"):
        write_atomic(tmp_path / "taken", b"data")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
