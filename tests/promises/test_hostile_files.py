"""Files from strangers: checkpoints and settings made to harm are refused before any use, with file and defect."""

from __future__ import annotations

import json
import pickle
import time
from pathlib import Path

import pytest
import torch

import randomization
from tactile_kit.files import digest, tensor_bytes
from tactile_kit.runs import CheckpointError, ConfigError, RunConfig
from tactile_kit.runs import checkpoint as checkpoints


class Bomb:
    def __reduce__(self):
        return (pytest.fail, ("unpickled",))


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    tensors, values = {"a": torch.arange(3.0)}, {"config": {}, "versions": {}}
    return checkpoints.save(tmp_path / "checkpoints", 7, tensors, values)


def forge(path: Path, **changes) -> None:
    """Change state.json, with a digest that fits."""
    body = {**json.loads((path / "state.json").read_text()), **changes}
    body = {key: value for key, value in body.items() if value is not None and key != "digest"}
    body["digest"] = digest(json.dumps(body, sort_keys=True).encode())
    (path / "state.json").write_text(json.dumps(body))


def test_a_forged_digest_alone_changes_nothing(saved: Path) -> None:
    forge(saved)
    assert checkpoints.load(saved).step == 7


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"schema": 2}, "schema 2, this version reads 1"),
        ({"schema": None}, "schema None"),
        ({"files": None}, "files"),
        ({"files": {}}, "files"),
        ({"files": ["state.safetensors"]}, "files"),
        ({"files": {"state.safetensors": 5}}, "files"),
        ({"files": {"state.safetensors": "0", "replay-../../outside.npz": "0"}}, "files"),
        ({"files": {"state.safetensors": "0", "/etc/passwd": "0"}}, "files"),
        ({"step": "7"}, "step"),
        ({"step": -1}, "step"),
        ({"values": [1]}, "values"),
        ({"values": {"config": {}}}, "versions"),
        ({"surprise": 1}, "surprise"),
        ({"values": {"config": {}, "versions": {}, "hours": float("inf")}}, "Infinity"),
    ],
)
def test_forged_checkpoints_are_refused(saved: Path, changes: dict, match: str) -> None:
    forge(saved, **changes)
    with pytest.raises(CheckpointError, match=match) as caught:
        checkpoints.load(saved)
    assert "state.json" in str(caught.value)


def test_files_of_a_checkpoint_are_not_unpickled(saved: Path) -> None:
    files = json.loads((saved / "state.json").read_text())["files"]
    for name, data in (
        ("state.safetensors", pickle.dumps(Bomb())),
        ("state.safetensors", tensor_bytes({"a": torch.zeros(2)})[:-3]),
    ):
        good = (saved / name).read_bytes()
        (saved / name).write_bytes(data)
        forge(saved, files={**files, name: digest(data)})
        with pytest.raises(CheckpointError, match="not a safetensors file"):
            checkpoints.load(saved)
        (saved / name).write_bytes(good)


def test_links_out_of_a_checkpoint_gain_nothing(saved: Path, tmp_path: Path) -> None:
    """What a link points at must have the digest that state.json names, and is only ever read as tensors."""
    secret = tmp_path / "secret"
    secret.write_text("secret")
    (saved / "state.safetensors").unlink()
    (saved / "state.safetensors").symlink_to(secret)
    with pytest.raises(CheckpointError, match="SHA-256"):
        checkpoints.load(saved)


def test_nesting_without_end_is_refused(saved: Path) -> None:
    (saved / "state.json").write_text('{"a":' * 100_000 + "1" + "}" * 100_000)
    with pytest.raises(CheckpointError, match=r"state\.json: not JSON"):
        checkpoints.load(saved)


LAUGHS = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12)
)


@pytest.mark.parametrize(
    "text",
    [
        "!!python/object/apply:os.system ['true']",
        "steps: !!python/name:os.system",
        "steps: !include /etc/passwd",
        LAUGHS + "steps: *a11\n",
        LAUGHS,
        LAUGHS + "encoding: *a11\ntask: {encoding: *a10}\n",
        LAUGHS + "summary: *a11\nterms: {}\n",
        "[" * 2000,
        "steps: 9" + "9" * 5000,
        "\x00",
        "steps: !!int ''",
        "steps: !!bool often",
        "steps: !!timestamp soon",
        "steps: !!float ''",
    ],
    ids=[
        "apply",
        "name",
        "include",
        "laughs as a value",
        "laughs",
        "laughs twice",
        "laughs as a text",
        "nesting",
        "long number",
        "null",
        "no int",
        "no bool",
        "no date",
        "no float",
    ],
)
@pytest.mark.parametrize("read", [RunConfig.from_yaml, randomization.preset], ids=["run", "randomization"])
def test_settings_made_to_harm_are_refused_at_once(tmp_path: Path, read, text: str) -> None:
    path = tmp_path / "settings.yaml"
    path.write_text(text)
    begin = time.process_time()
    with pytest.raises((ConfigError, randomization.RandomizationError)) as caught:
        read(str(path))
    assert str(path) in str(caught.value) and len(str(caught.value)) < 5000
    assert time.process_time() - begin < 5
