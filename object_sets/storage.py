"""Arrays and texts on disk: npz without pickle and JSON, byte for byte the same for the same content, atomic."""

from __future__ import annotations

import hashlib
import io
import json
import os
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from object_sets.errors import DataError

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
    """The arrays of an npz. Raises ``DataError`` naming ``file`` when it is none, or asks for pickle."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise DataError(f"{file}: no readable npz ({error}); build the set again") from error


def json_bytes(content: Any) -> bytes:
    """Indented JSON in a fixed form, ending with a newline. Not-a-number is refused."""
    return (json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def sha256(data: bytes) -> str:
    """64 hex digits."""
    return hashlib.sha256(data).hexdigest()


def write_atomic(path: Path, data: bytes) -> None:
    """Write a file whole or not at all; its folder is made when missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def cache_directory() -> Path:
    """``$TACTILE_KIT_CACHE``, by default ``~/.cache/tactile-kit``; what is in it can be deleted at any time."""
    return Path(os.environ.get("TACTILE_KIT_CACHE") or Path.home() / ".cache" / "tactile-kit")
