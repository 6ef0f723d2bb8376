"""The same shapes in every dialect of the formats: what is read is what was written, and what other readers read."""

from __future__ import annotations

import importlib
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from object_sets import MeshError
from object_sets.importing import ImportConfig, import_mesh
from object_sets.mass import mass_properties
from object_sets.parsing import parse

CASES = Path(__file__).with_name("cases")

# cm^3 of the solid, or the reason for a refusal
VALUES = {
    "byte_order_mark.obj": 216,
    "concave_polygons.off": 84,
    "faces_with_tabs.obj": 30,
    "inside_out_beside_outward.obj": 56,
    "inside_out_overlapping.obj": 30,
    "loose_in_cavity.obj": "bodies that don't touch",
    "negative_indices.obj": 30,
    "solids_with_a_common_face.stl": 54,
    "stack.obj": 24,
    "trailing_comments.obj": 216,
}


@pytest.mark.parametrize("name", sorted(path.name for path in CASES.iterdir()))
def test_value_of_small_files(name):
    if isinstance(VALUES[name], str):
        with pytest.raises(MeshError, match=VALUES[name]):
            import_mesh(CASES / name, ImportConfig())
    else:
        mesh = import_mesh(CASES / name, ImportConfig())
        assert 1e6 * mass_properties(mesh.vertices, mesh.faces).volume == pytest.approx(
            VALUES[name], rel=1e-6
        )


def prism(outline, height):
    """Polygons over a plane outline: two caps and a wall of four corners along each side."""
    count = len(outline)
    points = np.array([(x, y, z) for z in (0.0, height) for x, y in outline])
    ring = list(range(count))
    walls = [[i, (i + 1) % count, (i + 1) % count + count, i + count] for i in ring]
    return points, [ring[::-1], [i + count for i in ring], *walls]


def shifted(shape, offset):
    points, polygons = shape
    return points + np.array(offset), polygons


SQUARE = [(0, 0), (0.03, 0), (0.03, 0.03), (0, 0.03)]
U_SHAPE = [(0.02, 0.06), (0, 0.06), (0, 0), (0.06, 0), (0.06, 0.06), (0.04, 0.06), (0.04, 0.02), (0.02, 0.02)]
ARROW = [(0, 0), (0.03, 0.02), (0.06, 0), (0.03, 0.06)]  # four corners, one of them looking inward
# bodies, cm^3 of all bodies together
SHAPES: dict[str, tuple[list, float]] = {
    "cube": ([prism(SQUARE, 0.03)], 27.0),
    "two bodies": ([prism(SQUARE, 0.03), shifted(prism(SQUARE, 0.03), (0.02, 0.01, 0.01))], 54.0),
    "U": ([prism(U_SHAPE, 0.03)], 84.0),
    "arrow": ([prism(ARROW, 0.04)], 48.0),
}


def obj(
    bodies,
    indent="",
    gap=" ",
    end="\n",
    bom=False,
    comment="",
    negative=False,
    corner="{}",
    split=False,
    head="",
):
    lines, start = [head] if head else [], 1
    for number, (points, polygons) in enumerate(bodies):
        lines.append(f"o body_{number}")
        lines += [f"{indent}v{gap}{gap.join(f'{value:.9g}' for value in point)}{comment}" for point in points]
        if "/" in corner:
            lines += [f"{indent}vt 0 0", f"{indent}vn 0 0 1"]
        for polygon in polygons:
            names = [corner.format(i - len(points) if negative else i + start) for i in polygon]
            words = gap.join(names)
            if split:  # a line may go on on the next
                words = gap.join(names[:2]) + f"{gap}\\{end}" + gap.join(names[2:])
            lines.append(f"{indent}f{gap}{words}{comment}")
        start += len(points)
    return (b"\xef\xbb\xbf" if bom else b"") + (end.join(lines) + end).encode()


def joined(bodies):
    points, polygons, start = [], [], 0
    for own, faces in bodies:
        points.append(own)
        polygons += [[i + start for i in face] for face in faces]
        start += len(own)
    return np.concatenate(points), polygons


def off(bodies, head="OFF\n{} {} 0\n", vertex="", face="", comment="", end="\n"):
    points, polygons = joined(bodies)
    lines = [" ".join(f"{value:.9g}" for value in point) + vertex + comment for point in points]
    lines += [f"{len(polygon)} {' '.join(map(str, polygon))}{face}{comment}" for polygon in polygons]
    return (head.format(len(points), len(polygons)) + "\n".join(lines) + "\n").replace("\n", end).encode()


def ply(bodies, kind="ascii", size="uchar", index="int", name="vertex_indices", extra=False):
    points, polygons = joined(bodies)
    more = "property uchar red\nproperty uchar green\nproperty uchar blue\n" if extra else ""
    head = (
        f"ply\nformat {kind} 1.0\ncomment made for a test\nelement vertex {len(points)}\nproperty double x\n"
        f"property double y\nproperty double z\n{more}element face {len(polygons)}\n"
        f"property list {size} {index} {name}\nend_header\n"
    ).encode()
    if kind == "ascii":
        rows = [" ".join(f"{value:.9g}" for value in point) + " 9 9 9" * extra for point in points]
        rows += [" ".join(map(str, [len(polygon), *polygon])) for polygon in polygons]
        return head + ("\n".join(rows) + "\n").encode()
    order = "<" if "little" in kind else ">"
    codes = {"uchar": "B", "int": "i", "uint": "I", "ushort": "H"}
    body = b"".join(struct.pack(f"{order}3d", *point) + b"\t\t\t" * extra for point in points)
    for polygon in polygons:
        body += struct.pack(f"{order}{codes[size]}{len(polygon)}{codes[index]}", len(polygon), *polygon)
    return head + body


def stl(bodies, binary=True, lower=True, head=b"made for a test"):
    solids = [trimesh.Trimesh(points, triangles(polygons), process=False) for points, polygons in bodies]
    if binary:
        data = trimesh.util.concatenate(solids).export(file_type="stl")
        return head.ljust(80, b" ") + data[80:]
    text = "\n".join(trimesh.exchange.stl.export_stl_ascii(solid) for solid in solids) + "\n"
    return (text if lower else text.upper()).encode()


def triangles(polygons):
    return [(face[0], face[i], face[i + 1]) for face in polygons for i in range(1, len(face) - 1)]


def fans(bodies):
    """Polygons cut into triangles beforehand, for formats and readers that know only these."""
    return [(points, [list(face) for face in triangles(polygons)]) for points, polygons in bodies]


Writer = Callable[[list], bytes]
DIALECTS: dict[str, Writer] = {
    "obj": obj,
    "obj, triangles": lambda bodies: obj(fans(bodies)),
    "obj, tabs": lambda bodies: obj(bodies, gap="\t"),
    "obj, indented": lambda bodies: obj(bodies, indent="  \t"),
    "obj, Windows": lambda bodies: obj(bodies, end="\r\n"),
    "obj, old Macintosh": lambda bodies: obj(bodies, end="\r"),
    "obj, byte-order mark": lambda bodies: obj(bodies, bom=True),
    "obj, comments": lambda bodies: obj(bodies, comment=" # v 1 2 3", head="# f 1 2 3"),
    "obj, negative": lambda bodies: obj(bodies, negative=True),
    "obj, negative, slashes": lambda bodies: obj(bodies, negative=True, corner="{}/-1/-1"),
    "obj, texture": lambda bodies: obj(bodies, corner="{}/1"),
    "obj, normals": lambda bodies: obj(bodies, corner="{}//1"),
    "obj, all": lambda bodies: obj(
        bodies, corner="{}/1/1", head="mtllib none.mtl\nusemtl a\ns off\n\nl 1 2\np 1\nf 1 2"
    ),
    "obj, continued": lambda bodies: obj(bodies, split=True),
    "off": off,
    "off, triangles": lambda bodies: off(fans(bodies)),
    "off, counts beside": lambda bodies: off(bodies, head="OFF {} {} 0\n"),
    "off, glued counts": lambda bodies: off(bodies, head="OFF{} {} 0\n"),
    "off, comments": lambda bodies: off(bodies, head="# a\nOFF # b\n\n{} {} 0\n# c\n", comment="  # d"),
    "off, face colours": lambda bodies: off(bodies, face=" 255 0 0"),
    "off, vertex colours": lambda bodies: off(bodies, head="COFF\n{} {} 0\n", vertex=" 255 0 0 255"),
    "off, normals": lambda bodies: off(bodies, head="NOFF\n{} {} 0\n", vertex=" 0 0 1"),
    "off, Windows": lambda bodies: off(bodies, end="\r\n"),
    "ply": ply,
    "ply, little": lambda bodies: ply(bodies, "binary_little_endian"),
    "ply, big": lambda bodies: ply(bodies, "binary_big_endian"),
    "ply, vertex_index": lambda bodies: ply(bodies, name="vertex_index"),
    "ply, colours": lambda bodies: ply(bodies, "binary_little_endian", extra=True),
    "ply, short": lambda bodies: ply(bodies, "binary_little_endian", "ushort", "uint"),
    "stl": stl,
    "stl, solid in the header": lambda bodies: stl(bodies, head=b"solid of a binary file"),
    "stl, ascii": lambda bodies: stl(bodies, binary=False),
    "stl, capitals": lambda bodies: stl(bodies, binary=False, lower=False),
}


def numbers(vertices, faces):
    """cm^3, number of bodies, extents in m: what a reader found."""
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return 1e6 * mesh.volume, mesh.body_count, np.ptp(vertices[np.unique(faces)], axis=0)


def by_trimesh(path):
    mesh = trimesh.load_mesh(path, process=False)
    return mesh.vertices, mesh.faces


def by_meshio(path):
    mesh = importlib.import_module("meshio").read(path)
    rows = [row for block in mesh.cells for row in block.data.tolist()]
    return mesh.points, triangles(rows)


def by_igl(path):
    return importlib.import_module("igl").read_triangle_mesh(str(path))


def by_plyfile(path):
    data = importlib.import_module("plyfile").PlyData.read(path)
    faces = data["face"].data
    points = np.column_stack([data["vertex"][axis] for axis in "xyz"])
    return points, triangles([face.tolist() for face in faces[faces.dtype.names[0]]])


READERS = {
    "obj": {"trimesh": by_trimesh, "meshio": by_meshio, "igl": by_igl},
    "off": {"trimesh": by_trimesh, "meshio": by_meshio, "igl": by_igl},
    "ply": {"trimesh": by_trimesh, "meshio": by_meshio, "plyfile": by_plyfile},
    "stl": {"trimesh": by_trimesh, "meshio": by_meshio, "igl": by_igl},
}


def agrees(reader, path, expected):
    """Whether another reader finds the same; None where it fails, or finds nothing at all."""
    try:
        found = numbers(*reader(path))
    except (Exception, SystemExit):  # meshio ends the process on what it doesn't know
        return None
    return all(np.allclose(a, b, rtol=1e-5, atol=1e-7) for a, b in zip(found, expected))


# Dialects that a reader reads otherwise, or reads not at all together with all the others.
OTHERWISE = {("obj, negative", "trimesh"), ("obj, negative", "meshio"), ("obj, negative, slashes", "trimesh")}
ALONE = {("obj, comments", name) for name in SHAPES}
ALONE |= {("off, glued counts", "U"), ("off, comments", "U")}


def area(bodies):
    """cm^2 of the polygons, which are planes: half the length of their vector area is that of any polygon."""
    total = 0.0
    for points, polygons in bodies:
        for polygon in polygons:
            corners = points[polygon]
            total += np.linalg.norm(np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)) / 2.0
    return 1e4 * total


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("dialect", DIALECTS)
def test_what_is_read_is_what_was_written(dialect, shape, tmp_path, capfd):
    bodies, volume = SHAPES[shape]
    path = tmp_path / f"mesh.{dialect[:3]}"
    path.write_bytes(DIALECTS[dialect](bodies))
    expected = (volume, len(bodies), np.ptp(joined(bodies)[0], axis=0))
    read = parse(path)
    for found, wanted in zip(numbers(read.vertices, read.faces), expected, strict=True):
        assert np.allclose(found, wanted, rtol=1e-5, atol=1e-7)
    others = {name: agrees(reader, path, expected) for name, reader in READERS[dialect[:3]].items()}
    wrong = {(dialect, name) for name, same in others.items() if same is False}
    assert wrong <= OTHERWISE, "another reader finds something else"
    assert any(others.values()) or (dialect, shape) in ALONE, "no other reader finds the same"


@pytest.mark.parametrize("dialect", DIALECTS)
def test_solids_of_every_dialect(dialect, tmp_path):
    """Through all of the import: overlapping bodies united, concave polygons cut without folds even from fans."""
    for name, volume in (("two bodies", 50), ("U", 84), ("arrow", 48)):
        bodies = SHAPES[name][0]
        path = tmp_path / f"mesh.{dialect[:3]}"
        path.write_bytes(DIALECTS[dialect](bodies))
        mesh = import_mesh(path, ImportConfig())
        assert 1e6 * mass_properties(mesh.vertices, mesh.faces).volume == pytest.approx(volume, rel=1e-5)
        if len(bodies) == 1:
            surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
            assert 1e4 * surface.area == pytest.approx(area(bodies), rel=1e-5)
