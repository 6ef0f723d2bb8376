"""Arrays and texts on disk: npz without pickle and JSON, byte for byte the same for the same content, atomic."""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from object_sets.errors import DataError, ObjectSetError

UNPACKED = 512 * 2**20  # bytes an npz may unpack to
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest time a zip can hold


def npz_bytes(arrays: Mapping[str, np.ndarray]) -> bytes:
    """An uncompressed npz of the arrays, with fixed timestamps: the bytes depend on nothing but the content."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            entry = io.BytesIO()
            np.lib.format.write_array(entry, np.asarray(array, order="C"), version=(1, 0), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", date_time=_EPOCH)
            info.external_attr = 0o644 << 16
            info.create_system = 3
            archive.writestr(info, entry.getvalue())
    return buffer.getvalue()


def read_npz(data: bytes, file: object) -> dict[str, np.ndarray]:
    """The arrays of an npz of this package.

    Raises ``DataError`` naming ``file`` when it is none, asks for pickle, or unpacks to far more than it holds.
    """
    arrays = {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
            if unpacked > UNPACKED:
                raise ValueError(f"unpacks to {unpacked / 2**20:.0f} MiB; allowed are {UNPACKED // 2**20}")
            for member in archive.infolist():
                arrays[member.filename.removesuffix(".npy")] = _array(archive.read(member))
    except Exception as error:  # zipfile and zlib raise a dozen kinds on broken input
        raise DataError(f"{file}: no readable npz ({error}); build the set again") from error
    return arrays


def _array(data: bytes) -> np.ndarray:
    """One npy of numbers. Its header is held against its length before any memory is asked for."""
    stream = io.BytesIO(data)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("npy of an unknown version")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    if dtype.hasobject or dtype.kind not in "biuf" or fortran:
        raise ValueError(f"an array of type {dtype} where plain numbers are expected")
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(data) - stream.tell():
        raise ValueError(f"an array of shape {shape} in {len(data)} bytes")
    return np.frombuffer(data, dtype, offset=stream.tell()).reshape(shape).copy()


def json_bytes(content: Any) -> bytes:
    """Indented JSON in a fixed form, ending with a newline. Not-a-number is refused."""
    return (json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def sha256(data: bytes) -> str:
    """64 hex digits."""
    return hashlib.sha256(data).hexdigest()


def write_atomic(path: Path, data: bytes) -> None:
    """``path`` holds either what it held before or all of ``data``, also after a power cut. Its folder is made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, 0o644)  # mkstemp makes private files; these are to be read like any other
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    sync_directory(path.parent)


def sync_directory(path: Path) -> None:
    """Make renames inside ``path`` durable."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def check_writable(place: Path, what: str) -> None:
    """Raise ``ObjectSetError`` naming ``what`` unless directory ``place`` can be made and written to; makes nothing."""
    there = place.absolute()
    while not there.exists() and there != there.parent:
        there = there.parent
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise ObjectSetError(f"{what} {place}: can't be written ({error.strerror}: {there})") from error


def check_file_writable(file: Path, what: str) -> None:
    """Raise ``ObjectSetError`` naming ``what`` unless ``file`` can be written, over an older one too."""
    if file.is_dir():
        raise ObjectSetError(f"{what} {file}: is a folder; name a file")
    check_writable(file.parent, what)


def cache_directory() -> Path:
    """``$TACTILE_KIT_CACHE``, by default ``~/.cache/tactile-kit``; what is in it can be deleted at any time.

    Who has no home that can be written to gets a folder among the temporary files.
    """
    named = os.environ.get("TACTILE_KIT_CACHE")
    if named:
        return Path(named)
    try:
        home = Path.home()
        check_writable(home / ".cache" / "tactile-kit", "cache")
    except (RuntimeError, ObjectSetError):  # a container's user without a home, or with / for one
        return Path(tempfile.gettempdir()) / f"tactile-kit-{os.getuid()}"
    return home / ".cache" / "tactile-kit"
