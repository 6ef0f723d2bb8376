"""Writing and reading files: atomic, with digests, never a pickle. torch is imported where tensors are asked for."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from object_sets.storage import sync_directory
from object_sets.storage import write_atomic as write_atomically
from tactile_kit.errors import AgentError

if TYPE_CHECKING:
    from torch import Tensor


def digest(data: bytes) -> str:
    """SHA-256, hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def staged(path: Path) -> Path:
    """Where the next version of ``path`` waits until a manifest names its digest."""
    return path.with_name(f"{path.name}.next")


def replace_together(directory: Path, weights: Mapping[str, bytes], manifest: str, content: bytes) -> None:
    """Replace the files ``weights`` and the file ``manifest``, whose ``content`` holds their digests, as one.

    The new weights first wait beside the old ones; the manifest decides which of them count. So a reader that checks
    digests finds a whole set at any moment, also after a kill between two of these files. Raises OSError.
    """
    settle(directory, manifest)
    for name, data in weights.items():
        write_atomically(staged(directory / name), data)
    write_atomically(directory / manifest, content)
    for name in weights:
        os.replace(staged(directory / name), directory / name)
    sync_directory(directory)


def settle(directory: Path, manifest: str) -> None:
    """Finish what a kill interrupted: move waiting weights that ``manifest`` names, remove unfinished files."""
    for path in directory.glob(".*"):
        if re.fullmatch(r"\..+\.\w{8}", path.name):  # of write_atomically
            path.unlink(missing_ok=True)
    try:
        wanted = dict(read_json(directory / manifest)["weights"])
    except (AgentError, KeyError, TypeError, ValueError):
        wanted = {}
    for waiting in directory.glob("*.safetensors.next"):
        if digest(waiting.read_bytes()) == wanted.get(waiting.stem):
            os.replace(waiting, directory / waiting.stem)
        else:
            waiting.unlink()


def tensor_bytes(tensors: Mapping[str, Tensor]) -> bytes:
    """Tensors in safetensors form; shared storage is written once for each name."""
    import safetensors.torch

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
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as problem:
        raise error(f"{path}: not JSON ({problem})") from None
    if not isinstance(value, dict):
        raise error(f"{path}: holds {type(value).__name__}, expected an object")
    return value


def read_tensors(path: Path, expected: str, error: type[ValueError] = AgentError) -> dict[str, Tensor]:
    """Tensors of a safetensors file whose SHA-256 is ``expected``; raises ``error`` before anything is used.

    After a kill the file of that digest may still be waiting to take its place (see :func:`replace_together`).
    """
    import safetensors.torch

    problem = f"{path}: No such file or directory"
    for candidate in (path, staged(path)):
        try:
            data = candidate.read_bytes()
        except FileNotFoundError:
            continue
        except OSError as failure:
            raise error(f"{candidate}: {failure.strerror}") from None
        found = digest(data)
        if found == expected:
            break
        problem = f"{candidate}: SHA-256 is {found[:16]}…, the manifest says {str(expected)[:16]}…"
    else:
        raise error(problem)
    try:
        return safetensors.torch.load(data)
    except (safetensors.SafetensorError, ValueError, KeyError) as failure:
        raise error(f"{candidate}: not a safetensors file ({failure})") from None
