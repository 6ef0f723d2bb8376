"""PLY: vertices and polygons of text and binary files; whatever else a file holds is passed over.

Read here because trimesh (5.2) takes no binary file whose polygons have several sizes, and cuts concave polygons into
fans that fold over themselves.
"""

from __future__ import annotations

from struct import Struct
from typing import NamedTuple

import numpy as np

from object_sets.polygons import BOM, triangles_of

# letter of struct and numpy, by each of its two names
TYPES = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H",
    "int": "i", "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f", "double": "d", "float64": "d",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNERS = ("vertex_indices", "vertex_index")


class Property(NamedTuple):
    """Of an element; ``size`` is the type of a list's length, empty for a plain number."""

    name: str
    kind: str
    size: str = ""


class Element(NamedTuple):
    """A table of the file."""

    name: str
    rows: int
    properties: list[Property]


def read_ply(data: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (V, 3) float64, faces (F, 3) int64 and groups (F,), all 0.

    Raises:
        ValueError: the file is none, ends too early, or holds what the format doesn't know.
    """
    form, elements, body = _header(data.removeprefix(BOM))
    words = body.split() if form == "ascii" else []
    vertices, polygons, start = np.zeros((0, 3)), [], 0
    for element in elements:
        if form == "ascii":
            rows, start = _text(words, start, element)
        else:
            rows, start = _binary(body, start, element, ORDERS[form])
        columns = {item.name: rows[place] for place, item in enumerate(element.properties)}
        if element.name == "vertex":
            vertices = np.column_stack([np.asarray(columns[axis], np.float64) for axis in "xyz"])
        elif element.name == "face":
            for name in CORNERS:
                if name in columns:
                    polygons = [polygon for polygon in _whole(columns[name]) if len(polygon) > 2]
    faces, owner = triangles_of(vertices, polygons)
    return vertices, faces, np.zeros(len(owner), np.int64)


def _whole(rows) -> list:
    return (
        rows.astype(np.int64).tolist()
        if isinstance(rows, np.ndarray)
        else [[int(i) for i in row] for row in rows]
    )


def _header(data: bytes) -> tuple[str, list[Element], bytes]:
    """The format, the elements, and what follows the header."""
    form, elements, place = "", [], 0
    while True:
        end = data.find(b"\n", place)
        if end < 0 or place > 2**20:
            raise ValueError("its header has no end")
        words = data[place:end].decode("latin-1").split()
        if place == 0 and words != ["ply"]:
            raise ValueError("it does not start with 'ply'")
        place = end + 1
        match words:
            case ["format", name, *_]:
                form = name
            case ["element", name, count]:
                elements.append(Element(name, int(count), []))
            case ["property", "list", size, kind, name]:
                elements[-1].properties.append(Property(name, TYPES[kind], TYPES[size]))
            case ["property", kind, name]:
                elements[-1].properties.append(Property(name, TYPES[kind]))
            case ["end_header"]:
                break
    if form not in ORDERS:
        raise ValueError(f"format {form!r}")
    return form, elements, data[place:]


def _text(words: list[bytes], start: int, element: Element) -> tuple[list, int]:
    """The columns of an element from words, and where the next one starts."""
    columns: list[list] = [[] for _ in element.properties]
    width = len(element.properties)
    if not any(item.size for item in element.properties):
        end = start + element.rows * width
        if end > len(words):
            raise ValueError(f"ends before its {element.rows} of {element.name}")
        table = np.array(words[start:end]).astype(np.float64).reshape(-1, width)
        return list(table.T), end
    for _ in range(element.rows):
        for column, item in zip(columns, element.properties):
            if start >= len(words):
                raise ValueError(f"ends before its {element.rows} of {element.name}")
            if item.size:
                length = int(words[start])
                column.append([float(word) for word in words[start + 1 : start + 1 + length]])
                start += length
            else:
                column.append(float(words[start]))
            start += 1
    return columns, start


def _binary(body: bytes, start: int, element: Element, order: str) -> tuple[list, int]:
    """The columns of an element from bytes, and where the next one starts."""
    if element.rows == 0:
        return [[] for _ in element.properties], start
    lengths = _lengths(body, start, element, order)
    row = np.dtype(
        [
            field
            for place, item in enumerate(element.properties)
            for field in _fields(place, item, lengths, order)
        ]
    )
    end = start + element.rows * row.itemsize
    if end <= len(body):
        table = np.frombuffer(body, row, element.rows, start)
        if all((table[f"size{place}"] == length).all() for place, length in lengths.items()):
            return [table[f"value{place}"] for place in range(len(element.properties))], end
    return _rows(body, start, element, order)


def _fields(place: int, item: Property, lengths: dict[int, int], order: str) -> list[tuple]:
    if not item.size:
        return [(f"value{place}", order + item.kind)]
    return [(f"size{place}", order + item.size), (f"value{place}", order + item.kind, (lengths[place],))]


def _lengths(body: bytes, start: int, element: Element, order: str) -> dict[int, int]:
    """How long the lists of the first row are; most often those of all rows are as long."""
    lengths = {}
    for place, item in enumerate(element.properties):
        if item.size:
            reader = Struct(order + item.size)
            lengths[place] = int(reader.unpack_from(body, start)[0])
            start += reader.size + lengths[place] * Struct(order + item.kind).size
        else:
            start += Struct(order + item.kind).size
    return lengths


def _rows(body: bytes, start: int, element: Element, order: str) -> tuple[list, int]:
    """As ``_binary``, row by row: lists have several lengths."""
    columns: list[list] = [[] for _ in element.properties]
    readers = [
        (Struct(order + (item.size or item.kind)), item, column)
        for item, column in zip(element.properties, columns)
    ]
    for _ in range(element.rows):
        for reader, item, column in readers:
            (value,) = reader.unpack_from(body, start)
            start += reader.size
            if item.size:
                values = Struct(f"{order}{value}{item.kind}")
                value = values.unpack_from(body, start)
                start += values.size
            column.append(value)
    return columns, start
