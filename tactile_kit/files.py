"""Writing and reading files: atomic, with digests, never a pickle. torch is imported where tensors are asked for."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from object_sets.storage import sync_directory, write_atomic
from tactile_kit.errors import AgentError

if TYPE_CHECKING:
    from torch import Tensor

MOST_TEXT = 256 * 2**20  # bytes of a text that is read at once
# beside its own errors, what PyYAML raises for values that are not what their tag says (``!!int ""``, ``!!bool x``)
YAML_RAISES = (ValueError, LookupError, AttributeError, TypeError, OverflowError, RecursionError)
OWNER = "owner"  # among what a safetensors file says of itself


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
        write_atomic(staged(directory / name), data)
    write_atomic(directory / manifest, content)
    for name in weights:
        os.replace(staged(directory / name), directory / name)
    sync_directory(directory)


def settle(directory: Path, manifest: str) -> None:
    """Finish what a kill interrupted: move waiting weights that ``manifest`` names, remove unfinished files."""
    for path in directory.glob(".*"):
        if re.fullmatch(r"\..+\.\w{8}", path.name):  # of write_atomic
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


def tensor_bytes(tensors: Mapping[str, Tensor], owner: str = "") -> bytes:
    """Tensors in safetensors form; shared storage is written once for each name. ``owner``: what they belong to."""
    import safetensors.torch

    return safetensors.torch.save(
        {name: tensor.detach().clone().contiguous() for name, tensor in tensors.items()},
        {OWNER: owner} if owner else None,
    )


def json_bytes(value: Any) -> bytes:
    """JSON, indented, refusing NaN."""
    return (json.dumps(value, indent=1, allow_nan=False) + "\n").encode()


def read_text(path: Path, error: type[ValueError], what: str = "file") -> str:
    """The text (UTF-8) in ``path``, which is ``what``; raises ``error`` naming the file, whatever is wrong with it."""
    try:
        if path.stat().st_size > MOST_TEXT:
            raise error(f"{path}: {path.stat().st_size:,} bytes; allowed are {MOST_TEXT:,}")
        return path.read_bytes().decode()
    except FileNotFoundError:
        raise error(f"{path}: no such {what}") from None
    except OSError as problem:
        raise error(f"{path}: {problem.strerror}") from None
    except UnicodeDecodeError as problem:
        raise error(f"{path}: no text in UTF-8 ({problem})") from None


def read_yaml(path: Path, error: type[ValueError]) -> Any:
    """What plain YAML in ``path`` says; raises ``error`` naming the file."""
    import yaml

    text = read_text(path, error)
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, *YAML_RAISES) as problem:
        raise error(f"{path}: not plain YAML: {' '.join(str(problem).split())}") from None


def _refused(constant: str) -> None:
    raise ValueError(f"{constant} is no number")


def read_json(path: Path, error: type[ValueError] = AgentError) -> dict[str, Any]:
    """A JSON object from ``path``; raises ``error`` naming the file."""
    text = read_text(path, error)
    try:
        value = json.loads(text, parse_constant=_refused)
    except (ValueError, RecursionError) as problem:
        raise error(f"{path}: not JSON ({problem})") from None
    if not isinstance(value, dict):
        raise error(f"{path}: holds {type(value).__name__}, expected an object")
    return value


def read_tensors(
    path: Path, expected: str, error: type[ValueError] = AgentError, owner: str = ""
) -> dict[str, Tensor]:
    """Tensors of a safetensors file whose SHA-256 is ``expected``; raises ``error`` before anything is used.

    A file that says what it belongs to must say ``owner``, where one is given.
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
        tensors = safetensors.torch.load(data)
        said = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")]).get("__metadata__", {}).get(OWNER)
    except (safetensors.SafetensorError, ValueError, LookupError, TypeError, RuntimeError) as failure:
        raise error(f"{candidate}: not a safetensors file ({failure})") from None
    if owner and said not in (None, owner):
        raise error(
            f"{candidate}: weights of another agent than the one that stands beside them (altered since)"
        )
    return tensors
