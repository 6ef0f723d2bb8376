"""Checkpoints: directories of safetensors and JSON that are there whole or not at all.

A checkpoint is written beside its place, flushed to disk and renamed. Its state.json names the SHA-256 of every other
file and of its own values, so damage is found before anything is used, and the one before can take its place.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor

from object_sets.storage import write_atomic
from tactile_kit.errors import CheckpointError
from tactile_kit.files import (
    digest,
    json_bytes,
    read_json,
    read_tensors,
    sync_directory,
    tensor_bytes,
)

SCHEMA = 1


@dataclass
class Checkpoint:
    """What was saved: environment steps, tensors and JSON values."""

    path: Path
    step: int
    tensors: dict[str, Tensor]
    values: dict[str, Any]


def save(
    folder: Path,
    step: int,
    tensors: Mapping[str, Tensor],
    values: Mapping[str, Any],
    keep: int = 2,
) -> Path:
    """Write ``folder/step-…`` and drop all but the ``keep`` newest. Raises OSError (disk full, read-only), having
    changed nothing that was there."""
    folder.mkdir(parents=True, exist_ok=True)
    for stale in folder.glob(".writing-*"):
        shutil.rmtree(stale, ignore_errors=True)
    final = folder / f"step-{step:012d}"
    temporary = folder / f".writing-{final.name}"
    temporary.mkdir()
    try:
        data = tensor_bytes(tensors)
        write_atomic(temporary / "state.safetensors", data)
        files = {"state.safetensors": digest(data)}
        body = {"schema": SCHEMA, "step": step, "files": files, "values": dict(values)}
        body["digest"] = _body_digest(body)
        write_atomic(temporary / "state.json", json_bytes(body))
        if final.exists():  # the same step saved again, after a damaged save
            shutil.rmtree(final)
        os.rename(temporary, final)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    sync_directory(folder)
    for old in listing(folder)[:-keep]:
        shutil.rmtree(old, ignore_errors=True)
    return final


def listing(folder: Path) -> list[Path]:
    """Checkpoint directories, oldest first."""
    return sorted(path for path in folder.glob("step-*") if path.is_dir())


def load(path: Path) -> Checkpoint:
    """One checkpoint, all digests checked; raises CheckpointError naming file and reason."""
    body = read_json(path / "state.json", CheckpointError)
    if body.get("schema") != SCHEMA:
        raise CheckpointError(
            f"{path / 'state.json'}: schema {body.get('schema')!r}, this version reads {SCHEMA}"
        )
    try:
        found = _body_digest({key: value for key, value in body.items() if key != "digest"})
    except (ValueError, RecursionError) as problem:  # a number such as 1e999, or nesting
        raise CheckpointError(f"{path / 'state.json'}: {problem}") from None
    if body.get("digest") != found:
        raise CheckpointError(f"{path / 'state.json'}: does not match its own digest")
    files = _checked_body(body, path / "state.json")
    tensors = read_tensors(path / "state.safetensors", files["state.safetensors"], CheckpointError)
    return Checkpoint(path, body["step"], tensors, body["values"])


def _checked_body(body: dict[str, Any], where: Path) -> dict[str, str]:
    """The files that a checkpoint names, all of its entries checked."""
    unknown = sorted(set(body) - {"schema", "step", "files", "values", "digest"})
    if unknown:
        raise CheckpointError(f"{where}: unknown entries {unknown}")
    step, files, values = body.get("step"), body.get("files"), body.get("values")
    if type(step) is not int or step < 0:
        raise CheckpointError(f"{where}: step is {step!r}, allowed are integers from 0")
    if (
        not isinstance(files, dict)
        or set(files) != {"state.safetensors"}
        or not isinstance(files["state.safetensors"], str)
    ):
        raise CheckpointError(f"{where}: files are {files!r}, allowed is the digest of state.safetensors")
    for name in ("config", "versions"):
        if not isinstance(values, dict) or not isinstance(values.get(name), dict):
            raise CheckpointError(f"{where}: values hold no {name}")
    return files


def newest(folder: Path) -> tuple[Checkpoint | None, list[str]]:
    """The newest usable checkpoint and a message for each damaged one passed over.

    None when there is no checkpoint at all; raises CheckpointError when there are some and all are damaged.
    """
    messages: list[str] = []
    found = listing(folder)
    for path in reversed(found):
        try:
            return load(path), messages
        except CheckpointError as problem:
            messages.append(f"checkpoint {path.name} is damaged ({problem}); falling back to the one before")
    if found:
        raise CheckpointError(f"{folder}: no usable checkpoint: " + "; ".join(messages))
    return None, messages


def _body_digest(body: Mapping[str, Any]) -> str:
    return digest(json.dumps(body, sort_keys=True, allow_nan=False).encode())
