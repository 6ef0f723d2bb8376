"""What a file is when it is no mesh: named for what it is, before a parser guesses."""

from __future__ import annotations

import re
from pathlib import Path

from object_sets.errors import MeshError

HEADER = 84  # bytes of a binary STL before its triangles of 50 bytes each

# how a file begins (spaces and byte-order marks left out), what it is, what to do
SIGNS: tuple[tuple[bytes, str, str], ...] = (
    (
        rb"version https://git-lfs",
        "is a Git LFS pointer: the mesh itself was not fetched",
        "run 'git lfs pull'",
    ),
    (
        rb"(?i)<(!doctype html|html)",
        "is an HTML page",
        "download the file itself, not the page that shows it",
    ),
    (rb"(?i)<\?xml.*?<(error|html)", "is an error page of a server", "download it again"),
    (rb"\x1f\x8b|PK\x03\x04|7z\xbc\xaf|Rar!", "is an archive", "unpack it and give what is in it"),
    (rb"%PDF|\x89PNG|\xff\xd8\xff|GIF8", "is a picture or a document", "give the mesh"),
)


def check_nature(path: Path, data: bytes, kind: str) -> None:
    """Raise ``MeshError`` when a file ``kind`` ("stl", ...) is of another nature, or a cut-off STL."""
    start = data[:512].removeprefix(b"\xef\xbb\xbf").lstrip()
    for sign, nature, remedy in SIGNS:
        if re.match(sign, start, re.DOTALL) and not (kind == "3mf" and start.startswith(b"PK")):
            raise MeshError(path, nature, remedy)
    if kind == "stl":
        _check_whole(path, data)


def without_trailer(data: bytes) -> bytes:
    """A binary STL without what some exporters write behind its triangles; anything else as it is."""
    whole = HEADER + 50 * int.from_bytes(data[80:HEADER], "little")
    text = re.search(rb"(?i)\bfacet\s+normal", data[:4096])
    return data[:whole] if HEADER < whole < len(data) and not text else data


def _check_whole(path: Path, data: bytes) -> None:
    count = int.from_bytes(data[80:HEADER], "little")
    whole = HEADER + 50 * count
    if len(data) == whole:
        return
    if data[:512].lstrip().lower().startswith(b"solid"):
        facets = len(re.findall(rb"(?i)\bfacet\s+normal", data))
        ends = len(re.findall(rb"(?i)\bendfacet", data))
        if facets and (facets != ends or not re.search(rb"(?i)endsolid[^\n]*\s*$", data)):
            raise MeshError(
                path, f"is cut off: {ends} of its triangles are whole", "download or export it again"
            )
    elif HEADER <= len(data) < whole:
        raise MeshError(
            path, f"is cut off: it announces {count} triangles and holds {(len(data) - HEADER) // 50}",
            "download or export it again",
        )  # fmt: skip
