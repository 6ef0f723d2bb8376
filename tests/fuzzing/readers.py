"""Every reader of files that strangers may have made: what it reads, what it refuses them with, and whole examples."""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import object_sets
import randomization
from object_sets.errors import ObjectSetError
from object_sets.parsing import parse
from object_sets.storage import json_bytes, npz_bytes, read_npz, sha256
from randomization import RandomizationError
from reproduce.cells import COLUMNS as CELL_COLUMNS
from reproduce.cells import read_cells
from reproduce.errors import ReproduceError
from reproduce.files import ROOT
from reproduce.results import read_curve
from reproduce.scales import load_scale
from tactile_kit.agents.agent import load_agent
from tactile_kit.errors import AgentError, CheckpointError, ConfigError, EpisodeFileError
from tactile_kit.evaluation.courses import read_courses
from tactile_kit.evaluation.rows import read_rows
from tactile_kit.files import digest, tensor_bytes
from tactile_kit.runs import RunConfig
from tactile_kit.runs import checkpoint as checkpoints
from tactile_kit.simulation import dump as dumps

AGENT = ROOT / "results" / "agents" / "oracle-none-cube-s1"
CUBE = object_sets.load("all")["cube"]


@dataclass(frozen=True)
class Reader:
    """One kind of file.

    Attributes:
        ending: of the file's name.
        read: puts the file to use: the bytes, and the empty folder to lay them down in; returns what errors must name.
        refuses: what it may raise.
        examples: whole files, to begin from.
    """

    ending: str
    read: Callable[[bytes, Path], None]
    refuses: tuple[type[Exception], ...]
    examples: Callable[[], Iterable[bytes]]


def plain(read: Callable[[Path], object], ending: str) -> Callable[[bytes, Path], None]:
    """A reader of one file that stands alone."""

    def put(data: bytes, folder: Path) -> None:
        file = folder / f"file{ending}"
        file.write_bytes(data)
        read(file)

    return put


def _agent(data: bytes, folder: Path) -> None:
    """agent.json beside weights that are whole."""
    (folder / "agent.json").write_bytes(data)
    shutil.copy(AGENT / "policy.safetensors", folder)
    load_agent(folder)


def _weights(data: bytes, folder: Path) -> None:
    """Weights whose digest agent.json names."""
    content = json.loads((AGENT / "agent.json").read_text())
    content["weights"]["policy.safetensors"] = digest(data)
    (folder / "agent.json").write_text(json.dumps(content))
    (folder / "policy.safetensors").write_bytes(data)
    load_agent(folder)


def _signed(data: bytes, sign: Callable[[dict], bytes]) -> bytes:
    """JSON with a digest that fits, so that what lies behind it is reached."""
    try:
        content = json.loads(data)
        return sign(content) if isinstance(content, dict) else data
    except (ValueError, RecursionError):
        return data


def _checkpoint(data: bytes, folder: Path) -> None:
    def sign(body: dict) -> bytes:
        body.pop("digest", None)
        return json.dumps({**body, "digest": digest(json.dumps(body, sort_keys=True).encode())}).encode()

    (folder / "state.json").write_bytes(_signed(data, sign))
    (folder / "state.safetensors").write_bytes(TENSORS)
    checkpoints.load(folder)


TENSORS = tensor_bytes({})


def _object_set(data: bytes, folder: Path) -> None:
    def sign(content: dict) -> bytes:
        content.pop("digest", None)
        return json_bytes({**content, "digest": sha256(json_bytes(content))})

    (folder / "manifest.json").write_bytes(_signed(data, sign))
    (folder / "cube.npz").write_bytes(ARRAYS)
    object_sets.load(folder)


SHIPPED = Path(object_sets.__file__).parent / "data"
ARRAYS = (SHIPPED / "cube.npz").read_bytes()


def _one_object() -> bytes:
    content = json.loads((SHIPPED / "manifest.json").read_text())
    content["objects"] = [entry for entry in content["objects"] if entry["name"] == "cube"]
    return json.dumps(content).encode()


def _mesh(ending: str) -> Reader:
    def examples() -> Iterable[bytes]:
        import trimesh

        mesh = trimesh.Trimesh(CUBE.vertices, CUBE.faces, process=False)
        for encoding in {"ply": ("ascii", "binary"), "stl": ("stl", "stl_ascii")}.get(ending, ("",)):
            options = {"encoding": encoding} if ending == "ply" else {}
            kind = encoding if ending == "stl" else ending
            found = mesh.export(file_type=kind, **options)
            yield found.encode() if isinstance(found, str) else found

    return Reader(f".{ending}", plain(parse, f".{ending}"), (ObjectSetError, MemoryError), examples)


def _dump() -> Iterable[bytes]:
    start = {"variant": 0, "seed": 1, "gravity": 9.81, "body": "cube", "horizon": 9, "config": {}}
    state = {name: np.zeros(shape) for name, shape in dumps.STATE.items()}
    buffer = io.BytesIO()
    head = json.dumps({"schema": dumps.SCHEMA, "fault": "thrown", "start": start})
    arrays = {f"state.{name}": value for name, value in state.items()}
    np.savez(buffer, allow_pickle=False, head=np.array(head), actions=np.zeros((2, 12)), **arrays)
    yield buffer.getvalue()


def _lines(path: Path, count: int) -> bytes:
    return b"".join(path.read_bytes().splitlines(keepends=True)[:count])


EPISODES = ROOT / "results" / "episodes"
CELL = "nominal,cube,success rate,0.9,0.8,0.7,0.9,10,episodes,8,measured,,a b,1 2"
READERS: dict[str, Reader] = {
    "agent": Reader(".json", _agent, (AgentError,), lambda: [(AGENT / "agent.json").read_bytes()]),
    "weights": Reader(
        ".safetensors", _weights, (AgentError,), lambda: [TENSORS, tensor_bytes({"mean.bias": _zeros()})]
    ),
    "checkpoint": Reader(
        ".json", _checkpoint, (CheckpointError,),
        lambda: [json.dumps({"schema": 1, "step": 3, "files": {"state.safetensors": digest(TENSORS)},
                             "values": {"config": {}, "versions": {}}}).encode()],
    ),
    "config": Reader(
        ".yaml", plain(RunConfig.from_yaml, ".yaml"), (ConfigError,),
        lambda: [(AGENT / "config.yaml").read_bytes(), b"preset: ppo-smoke\nsteps: 3\nencoding: bps\n"],
    ),
    "randomization": Reader(
        ".yaml", plain(lambda path: randomization.preset(str(path)), ".yaml"), (RandomizationError,),
        lambda: [b"extends: none\nterms:\n  joint_noise: {distribution: normal, mean: 0, std: 0.1}\n",
                 (Path(randomization.__file__).parent / "data/presets/strong.yaml").read_bytes()],
    ),
    "scale": Reader(
        ".yaml", plain(lambda path: load_scale(str(path)), ".yaml"), (ReproduceError,),
        lambda: [(ROOT / "reproduce/scales/smoke.yaml").read_bytes()],
    ),
    "rows": Reader(
        ".csv", plain(read_rows, ".csv"), (EpisodeFileError,),
        lambda: [_lines(EPISODES / "oracle-vec_bps-geometric8-s0/nominal.csv", 4)],
    ),
    "courses": Reader(
        ".csv", plain(read_courses, ".csv"), (EpisodeFileError,),
        lambda: [_lines(EPISODES / "tactile-vec_bps_fingers-geometric8-s0/sensitivity.csv", 4)],
    ),
    "curve": Reader(
        ".jsonl", plain(lambda path: read_curve("run", path), ".jsonl"), (ReproduceError,),
        lambda: [_lines(AGENT / "metrics.jsonl", 3)],
    ),
    "cells": Reader(
        ".csv", plain(read_cells, ".csv"), (ReproduceError,),
        lambda: [f"{','.join(CELL_COLUMNS)}\n{CELL}\n".encode()],
    ),
    "dump": Reader(".npz", plain(dumps.read, ".npz"), (dumps.DumpError,), _dump),
    "object_set": Reader(".json", _object_set, (ObjectSetError,), lambda: [_one_object()]),
    "arrays": Reader(
        ".npz", plain(lambda path: read_npz(path.read_bytes(), path), ".npz"), (ObjectSetError,),
        lambda: [npz_bytes({"faces": CUBE.faces, "count": np.array(3)})],
    ),
    **{f"mesh_{ending}": _mesh(ending) for ending in ("obj", "off", "ply", "stl", "glb", "3mf")},
}  # fmt: skip


def _zeros() -> object:
    import torch

    return torch.zeros(12)


def complaint(name: str, data: bytes, folder: Path) -> str:
    """What is wrong with how reader ``name`` takes ``data``, laid down in an empty ``folder``; empty: nothing.

    It must read it, or refuse it with an error of its own that names the file, in words that one can read.
    """
    reader = READERS[name]
    try:
        reader.read(data, folder)
    except MemoryError as error:
        return "" if MemoryError in reader.refuses else f"MemoryError: {error}"
    except reader.refuses as error:
        text = str(error)
        if str(folder) not in text:
            return f"names no file: {type(error).__name__}: {text[:300]}"
        return "" if len(text) < 20_000 else f"{len(text)} characters: {text[:300]}"
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:300]}"
    return ""
