"""Checkpoints: directories of safetensors and JSON that are there whole or not at all.

A checkpoint is written beside its place, flushed to disk and renamed. Its state.json names the SHA-256 of every other
file and of its own values, so damage is found before anything is used, and the one before can take its place.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from tactile_kit.agents.files import (
    digest,
    json_bytes,
    read_json,
    read_tensors,
    sync_directory,
    tensor_bytes,
    write_atomically,
)
from tactile_kit.runs.errors import CheckpointError

SCHEMA = 1


@dataclass
class Checkpoint:
    """What was saved: environment steps, tensors, JSON values and the file of the replay memory, if any."""

    path: Path
    step: int
    tensors: dict[str, Tensor]
    values: dict[str, Any]
    replay: Path | None

    def replay_arrays(self) -> dict[str, np.ndarray] | None:
        """The replay memory's arrays (digest already checked), or None when none was saved. Raises CheckpointError."""
        if self.replay is None:
            return None
        try:
            with np.load(self.replay, allow_pickle=False) as archive:
                return {name: archive[name] for name in archive.files}
        except (OSError, ValueError, EOFError, zipfile.BadZipFile) as problem:
            raise CheckpointError(f"{self.replay}: no arrays of a replay memory ({problem})") from None


def save(
    folder: Path,
    step: int,
    tensors: Mapping[str, Tensor],
    values: Mapping[str, Any],
    replay: Mapping[str, np.ndarray] | None = None,
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
        write_atomically(temporary / "state.safetensors", data)
        files = {"state.safetensors": digest(data)}
        if replay is not None:
            name = _replay_name(step)
            with (temporary / name).open("wb") as file:
                np.savez(file, **replay)  # type: ignore[arg-type]
                file.flush()
                os.fsync(file.fileno())
            files[name] = _file_digest(temporary / name)
        body = {"schema": SCHEMA, "step": step, "files": files, "values": dict(values)}
        body["digest"] = _body_digest(body)
        write_atomically(temporary / "state.json", json_bytes(body))
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
    if body.get("digest") != _body_digest({key: value for key, value in body.items() if key != "digest"}):
        raise CheckpointError(f"{path / 'state.json'}: does not match its own digest")
    files = _checked_body(body, path / "state.json")
    tensors = read_tensors(path / "state.safetensors", files["state.safetensors"], CheckpointError)
    replay = None
    for name in set(files) - {"state.safetensors"}:
        replay = path / name
        try:
            found = _file_digest(replay)
        except OSError as problem:
            raise CheckpointError(f"{replay}: {problem.strerror}") from None
        if found != files[name]:
            raise CheckpointError(f"{replay}: SHA-256 differs from state.json's")
    return Checkpoint(path, body["step"], tensors, body["values"], replay)


def _checked_body(body: dict[str, Any], where: Path) -> dict[str, str]:
    """The files that a checkpoint names, all of its entries checked."""
    unknown = sorted(set(body) - {"schema", "step", "files", "values", "digest"})
    if unknown:
        raise CheckpointError(f"{where}: unknown entries {unknown}")
    step, files, values = body.get("step"), body.get("files"), body.get("values")
    if type(step) is not int or step < 0:
        raise CheckpointError(f"{where}: step is {step!r}, allowed are integers from 0")
    allowed = {"state.safetensors", _replay_name(step)}
    if (
        not isinstance(files, dict)
        or not {"state.safetensors"} <= set(files) <= allowed
        or not all(isinstance(value, str) for value in files.values())
    ):
        raise CheckpointError(f"{where}: files are {files!r}, allowed are digests of {sorted(allowed)}")
    for name in ("config", "versions"):
        if not isinstance(values, dict) or not isinstance(values.get(name), dict):
            raise CheckpointError(f"{where}: values hold no {name}")
    return files


def _replay_name(step: int) -> str:
    return f"replay-{step:012d}.npz"


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


def _file_digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
