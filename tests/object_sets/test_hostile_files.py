"""Files meant to do harm, or too large: refused with a typed error, within bounds of memory and time."""

import base64
import json
import os
import signal
import struct
import subprocess
import sys
import time
import zipfile

import numpy as np
import psutil
import pytest
import trimesh

import object_sets
from object_sets import ImportConfig, Limits, MeshError, read_mesh
from object_sets.reading import Readers

SMALL = Limits(memory=1.5, timeout=60.0)
SHARED: list[Readers] = []


@pytest.fixture(scope="module", autouse=True)
def shared():
    """One set of worker processes for the whole file; that they outlive every case is part of the test."""
    with Readers() as readers:
        SHARED.append(readers)
        yield
        SHARED.clear()


def read(path, limits=SMALL):
    return SHARED[0].read(path, ImportConfig(), limits)


MODEL = (
    '<?xml version="1.0" encoding="UTF-8"?>{doctype}<model unit="meter" '
    'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>{objects}</resources>'
    '<build><item objectid="{top}"/></build></model>'
)


def write_3mf(path, objects, top="1", doctype=""):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", MODEL.format(objects=objects, top=top, doctype=doctype))
    return path


def tetrahedron_xml(identity="1"):
    corners = [(0, 0, 0), (0.05, 0, 0), (0, 0.05, 0), (0, 0, 0.05)]
    faces = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in corners)
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    return (
        f'<object id="{identity}" type="model"><mesh><vertices>{vertices}</vertices>'
        f"<triangles>{triangles}</triangles></mesh></object>"
    )


def write_gltf(path, uri, count=3):
    """A glTF file of one triangle mesh whose numbers lie in the buffer ``uri``."""
    content = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"uri": uri, "byteLength": 84}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 48},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 12, "type": "SCALAR"},
        ],
    }
    path.write_text(json.dumps(content))
    return path


def refused(path, defect, limits=SMALL):
    start = time.monotonic()
    with pytest.raises(MeshError, match=defect) as caught:
        read(path, limits)
    assert time.monotonic() - start < limits.timeout + 15
    assert str(path) == caught.value.file and caught.value.remedy
    return caught.value


def test_zip_bomb(tmp_path):
    """512 MiB of zeros pack into half a megabyte."""
    with (
        zipfile.ZipFile(tmp_path / "bomb.3mf", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("3D/3dmodel.model", "w", force_zip64=True) as stream,
    ):
        for _ in range(520):
            stream.write(bytes(2**20))
    assert (tmp_path / "bomb.3mf").stat().st_size < 2**20
    refused(tmp_path / "bomb.3mf", "unpacks to 520 MiB; allowed are 512")


def test_zip_that_lies_about_its_size(tmp_path):
    path = write_3mf(tmp_path / "lie.3mf", tetrahedron_xml())
    data = bytearray(path.read_bytes())
    for signature, offset in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        place = data.index(signature) + offset
        data[place : place + 4] = struct.pack("<I", 10)
    path.write_bytes(data)
    refused(path, "is no readable 3MF file")


def test_xml_that_defines_entities(tmp_path):
    bomb = '<!DOCTYPE m [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    refused(write_3mf(tmp_path / "laughs.3mf", tetrahedron_xml(), doctype=bomb), "DOCTYPE")
    path = tmp_path / "utf16.3mf"
    with zipfile.ZipFile(path, "w") as archive:
        text = MODEL.replace("UTF-8", "UTF-16").format(objects=tetrahedron_xml(), top="1", doctype=bomb)
        archive.writestr("3D/3dmodel.model", text.encode("utf-16"))
    refused(path, "DOCTYPE")


def test_components_that_multiply(tmp_path):
    """Twelve levels of ten references each would be a million million bodies."""
    objects = tetrahedron_xml("1")
    for level in range(2, 14):
        inner = f'<component objectid="{level - 1}"/>' * 10
        objects += f'<object id="{level}" type="model"><components>{inner}</components></object>'
    refused(write_3mf(tmp_path / "multiply.3mf", objects, top="13"), "consists of 1000000000000 bodies")
    objects = tetrahedron_xml("1") + (
        '<object id="2" type="model"><components><component objectid="1"/><component objectid="2"/>'
        "</components></object>"
    )
    refused(write_3mf(tmp_path / "itself.3mf", objects, top="2"), "consists of 50. bodies")


def test_bodies_are_never_lost(tmp_path):
    """Two levels of components: all 16 bodies arrive, or the file is refused."""
    objects = tetrahedron_xml("1")
    for level, axis in ((2, 0), (3, 1)):
        inner = ""
        for k in range(4):
            shift = ["0", "0", "0"]
            shift[axis] = str(0.02 * k)
            inner += f'<component objectid="{level - 1}" transform="1 0 0 0 1 0 0 0 1 {" ".join(shift)}"/>'
        objects += f'<object id="{level}" type="model"><components>{inner}</components></object>'
    path = write_3mf(tmp_path / "grid.3mf", objects, top="3")
    try:
        assert np.ptp(read(path).vertices, axis=0)[:2] == pytest.approx([0.11, 0.11])
    except MeshError as error:
        assert "holds 16 bodies, of which" in error.defect


def test_good_3mf_passes(tmp_path):
    """The files above are bad for the reason they are refused for, not for their frame."""
    mesh = read(write_3mf(tmp_path / "good.3mf", tetrahedron_xml()))
    assert mesh.repairs == () and np.allclose(np.ptp(mesh.vertices, axis=0), 0.05)


@pytest.mark.parametrize("uri", ["../secret.bin", "%2e%2e/secret.bin", "/etc/hostname", "link.bin"])
def test_gltf_that_climbs_out(tmp_path, uri):
    (tmp_path / "secret.bin").write_bytes(bytes(84))
    folder = tmp_path / "stranger"
    folder.mkdir()
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    error = refused(write_gltf(folder / "climb.gltf", uri), "names a file outside its folder")
    assert uri in str(error) or "../secret.bin" in str(error)


def test_gltf_with_its_buffer_beside_it(tmp_path):
    mesh = trimesh.creation.box((0.05, 0.05, 0.05))
    for name, data in trimesh.Scene(mesh).export(file_type="gltf").items():
        (tmp_path / name).write_bytes(data)
    assert read(tmp_path / "model.gltf").repairs == ()
    next(tmp_path.glob("*.bin")).unlink()
    refused(tmp_path / "model.gltf", "which is missing")


def test_gltf_that_claims_more_than_it_has(tmp_path):
    uri = "data:application/octet-stream;base64," + base64.b64encode(bytes(84)).decode()
    refused(write_gltf(tmp_path / "huge.gltf", uri, count=2**40), "no readable GLTF|GiB")


def test_materials_are_never_read(tmp_path):
    """An OBJ may name any path for its material: it isn't opened."""
    os.mkfifo(tmp_path / "pipe.mtl")  # reading it would wait for ever
    for name in ("pipe.mtl", "../../../etc/passwd", "/dev/zero"):
        text = trimesh.creation.box((0.05, 0.05, 0.05)).export(file_type="obj")
        (tmp_path / "named.obj").write_text(f"mtllib {name}\nusemtl a\n{text}")
        assert len(read(tmp_path / "named.obj").faces) == 12


@pytest.mark.parametrize(
    ("name", "content", "defect"),
    [
        ("empty.stl", b"", "no triangles"),
        (
            "header.stl",
            bytes(80) + struct.pack("<I", 2**32 - 1),
            "announces 4294967295 triangles and holds 0",
        ),
        (
            "cut.stl",
            trimesh.creation.box((1, 1, 1)).export(file_type="stl")[:300],
            "12 triangles and holds 4",
        ),
        (
            "claims.ply",
            b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty double x\n"
            b"property double y\nproperty double z\nelement face 4000000000\n"
            b"property list uchar int vertex_indices\nend_header\n\0\0",
            "no readable PLY|no triangles|GiB",
        ),
        ("claims.off", b"OFF\n999999999999 999999999999 0\n0 0 0\n", "no readable OFF"),
        (
            "far.obj",
            b"v 1e300 0 0\nv 0 1e300 0\nv 0 0 1e300\nv 0 0 0\nf 1 2 3\nf 1 2 4\nf 1 3 4\n",
            "as large as",
        ),
        ("index.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999\n", "no readable OBJ|faces that name"),
        ("pickle.3mf", b"\x80\x04\x95\x10\0\0\0\0\0\0\0\x8c\x08builtins", "no readable 3MF"),
    ],
)
def test_files_that_lie(tmp_path, name, content, defect):
    (tmp_path / name).write_bytes(content)
    refused(tmp_path / name, defect)


def test_not_a_file(tmp_path):
    os.mkfifo(tmp_path / "pipe.stl")
    refused(tmp_path / "pipe.stl", "no regular file")
    (tmp_path / "folder.stl").mkdir()
    refused(tmp_path / "folder.stl", "no regular file")


def soup(path, count):
    """A binary STL of ``count`` triangles that touch nothing: 50 bytes each, far more in memory."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    data = np.zeros(count, record)
    corners = np.random.default_rng(0).random((count, 3, 3), dtype=np.float32)
    data["corners"] = 0.1 * corners  # m: of a size that is allowed
    path.write_bytes(bytes(80) + struct.pack("<I", count) + data.tobytes())
    return path


def test_memory_is_bounded(tmp_path):
    refused(soup(tmp_path / "soup.stl", 2_000_000), "needs more than 0.6 GiB", Limits(0.6, 120.0))


def test_time_is_bounded(tmp_path):
    refused(soup(tmp_path / "soup.stl", 1_000_000), "takes longer than 2 s", Limits(4.0, 2.0))


@pytest.mark.slow
def test_five_million_triangles(tmp_path):
    """A closed surface that fine is simplified, or refused in time; a soup that large is refused."""
    rows, columns = 1600, 1600
    u, v = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a, b = 2 * np.pi * u / rows, 2 * np.pi * v / columns
    ring = 0.03 + 0.015 * np.cos(b)
    points = np.stack([ring * np.cos(a), ring * np.sin(a), 0.015 * np.sin(b)], axis=-1).reshape(-1, 3)
    index = lambda i, j: (i % rows) * columns + j % columns  # noqa: E731
    quads = np.stack([index(u, v), index(u + 1, v), index(u + 1, v + 1), index(u, v + 1)], axis=-1).reshape(
        -1, 4
    )
    faces = np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    data = np.zeros(len(faces), record)
    data["corners"] = points[faces]
    (tmp_path / "torus.stl").write_bytes(bytes(80) + struct.pack("<I", len(faces)) + data.tobytes())
    try:
        mesh = read(tmp_path / "torus.stl", Limits(8.0, 150.0))
        assert len(mesh.faces) <= 4000 and any("simplified 5120000" in repair for repair in mesh.repairs)
    except MeshError as error:
        assert error.defect.startswith(("takes longer than 150 s", "has 5120000 faces"))
    refused(soup(tmp_path / "soup.stl", 5_000_000), "is open|more than|takes longer", Limits(4.0, 100.0))


def test_a_folder_cannot_replace_modules(tmp_path, monkeypatch):
    """Standing in a stranger's folder runs none of its files."""
    for name in ("numpy", "trimesh", "json", "coacd", "resource"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()\n")
    trimesh.creation.box((0.05, 0.05, 0.05)).export(tmp_path / "box.stl")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    assert read_mesh("box.stl", limits=SMALL).repairs == ()
    assert not (tmp_path / "ran").exists()


def test_a_batch_survives_all_of_them(tmp_path, monkeypatch):
    monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "meshes"
    (folder / "deeper").mkdir(parents=True)
    write_gltf(folder / "climb.gltf", "../x.bin")
    soup(folder / "deeper" / "soup.stl", 1_000_000)
    trimesh.creation.box((0.05, 0.06, 0.07)).export(folder / "deeper" / "box.stl")
    path = object_sets.build(tmp_path / "set", meshes=folder, recursive=True, memory=0.6)
    manifest = json.loads(path.read_bytes())
    assert [entry["source"] for entry in manifest["objects"]] == ["deeper/box.stl"]
    assert {item["file"]: item["defect"].split("(")[0].strip() for item in manifest["refused"]} == {
        "climb.gltf": "names a file outside its folder",
        "deeper/soup.stl": "needs more than 0.6 GiB to read and repair",
    }


def test_no_process_is_left(tmp_path):
    """Neither after a good file nor after one that was stopped in the middle."""
    trimesh.creation.box((0.05, 0.06, 0.07)).export(tmp_path / "box.stl")
    before = set(psutil.Process().children(recursive=True))
    with Readers() as readers:
        with pytest.raises(MeshError, match="takes longer"):
            readers.read(soup(tmp_path / "soup.stl", 1_000_000), ImportConfig(), Limits(4.0, 0.5))
        assert len(readers.read(tmp_path / "box.stl", ImportConfig(), SMALL).faces) == 12
        assert len(set(psutil.Process().children(recursive=True)) - before) == 1  # one worker served both
    assert not set(psutil.Process().children(recursive=True)) - before


def _in_coacd(process):
    try:
        return "coacd_worker" in " ".join(process.cmdline())
    except psutil.Error:  # it has ended meanwhile
        return False


@pytest.mark.parametrize(("send", "code"), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)])
def test_an_interrupt_leaves_no_process(tmp_path, send, code):
    """In the middle of CoACD, by the keyboard or by force: whatever the command started ends with it."""
    folder = tmp_path / "meshes"
    folder.mkdir()
    thing = object_sets.load("all")["elephant"]
    trimesh.Trimesh(thing.vertices, thing.faces, process=False).export(folder / "elephant.stl")
    command = [sys.executable, "-m", "object_sets.cli", "build", "--meshes", str(folder)]
    settings = ["--coacd-threshold", "0.01", "--out", str(tmp_path / "set"), "--jobs", "1"]
    environment = {**os.environ, "TACTILE_KIT_CACHE": str(tmp_path / "cache")}
    build = subprocess.Popen([*command, *settings], env=environment, stderr=subprocess.PIPE, text=True)
    started: list[psutil.Process] = []
    deadline = time.monotonic() + 120.0
    while not any(map(_in_coacd, started)) and time.monotonic() < deadline:
        time.sleep(0.2)
        started = psutil.Process(build.pid).children(recursive=True)
    assert len(started) == 2  # the reader and CoACD
    build.send_signal(send)
    _, errors = build.communicate(timeout=30.0)
    assert build.returncode == code
    if send == signal.SIGINT:
        assert "interrupted" in errors.splitlines()[-1] and "Traceback" not in errors
    assert not psutil.wait_procs(started, timeout=10.0)[1]
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize("settings", [{"memory": 0.1}, {"timeout": 0.0}, {"memory": float("nan")}])
def test_limits_out_of_range(settings):
    with pytest.raises(object_sets.ObjectSetError, match=next(iter(settings))):
        Limits(**settings)


@pytest.mark.parametrize(
    "settings", [{"max_faces": 3}, {"center": "middle"}, {"alignment": "yup"}, {"extent": (0.1, 0.05)}]
)
def test_import_settings_out_of_range(settings):
    with pytest.raises(object_sets.ObjectSetError, match=next(iter(settings))):
        ImportConfig(**settings)
