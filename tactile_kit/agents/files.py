"""Writing and reading the files of an agent and of checkpoints: atomic, with digests, never a pickle."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
from torch import Tensor

from tactile_kit.agents.errors import AgentError


def digest(data: bytes) -> str:
    """SHA-256, hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def write_atomically(path: Path, data: bytes) -> None:
    """``path`` holds either what it held before or all of ``data``, also after a power cut."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, 0o644)  # mkstemp makes private files; these are to be read like any other
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    sync_directory(path.parent)


def sync_directory(path: Path) -> None:
    """Make renames inside ``path`` durable."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def tensor_bytes(tensors: Mapping[str, Tensor]) -> bytes:
    """Tensors in safetensors form; shared storage is written once for each name."""
    return safetensors.torch.save(
        {name: tensor.detach().clone().contiguous() for name, tensor in tensors.items()}
    )


def json_bytes(value: Any) -> bytes:
    """JSON, indented, refusing NaN."""
    return (json.dumps(value, indent=1, allow_nan=False) + "\n").encode()


def read_json(path: Path, error: type[ValueError] = AgentError) -> dict[str, Any]:
    """A JSON object from ``path``; raises ``error`` naming the file."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise error(f"{path}: no such file") from None
    except (UnicodeDecodeError, json.JSONDecodeError) as problem:
        raise error(f"{path}: not JSON ({problem})") from None
    if not isinstance(value, dict):
        raise error(f"{path}: holds {type(value).__name__}, expected an object")
    return value


def read_tensors(path: Path, expected: str, error: type[ValueError] = AgentError) -> dict[str, Tensor]:
    """Tensors of a safetensors file whose SHA-256 is ``expected``; raises ``error`` before anything is used."""
    try:
        data = path.read_bytes()
    except OSError as problem:
        raise error(f"{path}: {problem.strerror}") from None
    if digest(data) != expected:
        raise error(f"{path}: SHA-256 is {digest(data)[:16]}…, the manifest says {str(expected)[:16]}…")
    try:
        return safetensors.torch.load(data)
    except (safetensors.SafetensorError, ValueError, KeyError) as problem:
        raise error(f"{path}: not a safetensors file ({problem})") from None
