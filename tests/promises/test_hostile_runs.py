"""Runs from strangers, in both engines and with all that the shipped recipe uses.

A checkpoint whose digests all fit but whose contents are not this run's, and a teacher made to harm, are refused before
anything is trained.
"""

from __future__ import annotations

import json
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from promise_cases import RECIPE, TEACHER, environment, settings

from tactile_kit.agents import AgentError
from tactile_kit.files import digest
from tactile_kit.runs import CheckpointError, train
from tactile_kit.runs import checkpoint as checkpoints
from tactile_kit.runs.config import merge

STEPS = 192  # estimator and policy have both learned by then
Tensors = dict[str, torch.Tensor]


class Bomb:
    def __reduce__(self):
        return (pytest.fail, ("unpickled",))


@pytest.fixture(scope="module", params=["bullet", "compiled"])
def engine(request: pytest.FixtureRequest) -> str:
    return request.param


def play(engine: str, directory: Path, steps: int, kind: str = "tactile", **changes: Any) -> Path:
    config = settings(kind, steps, **merge(RECIPE[engine], changes))
    return train(config, directory, make_env=lambda config: environment(config, 0), quiet=True)


@pytest.fixture(scope="module")
def run(engine: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return play(engine, tmp_path_factory.mktemp(engine), STEPS)


def named(tensors: Tensors, beginning: str) -> str:
    """A tensor whose name begins so, up to a star, and ends so."""
    beginning, _, ending = beginning.partition("*")
    return next(name for name in tensors if name.startswith(beginning) and name.endswith(ending))


def swap(beginning: str, change: Callable[[torch.Tensor], torch.Tensor]) -> Callable[[Tensors, dict], None]:
    def forge(tensors: Tensors, values: dict) -> None:
        name = named(tensors, beginning)
        tensors[name] = change(tensors[name])

    return forge


def without(beginning: str) -> Callable[[Tensors, dict], None]:
    return lambda tensors, values: tensors.__delitem__(named(tensors, beginning))


def value(name: str, what: Any) -> Callable[[Tensors, dict], None]:
    return lambda tensors, values: values.update({name: what})


def wider(tensor: torch.Tensor) -> torch.Tensor:
    return torch.cat([tensor, tensor])


FORGERIES: dict[str, Callable[[Tensors, dict], None]] = {
    "policy of another shape": swap("learner/policy/actor.mean.weight", wider),
    "policy that is no number": swap("learner/policy/actor.mean.weight", lambda t: t * torch.nan),
    "policy without a layer": without("learner/policy/actor.mean.weight"),
    "moments of another shape": swap("learner/optimizer/*/exp_avg_sq", wider),
    "moments of a network that is not there": lambda tensors, values: tensors.update(
        {"learner/optimizer/999/exp_avg": torch.zeros(2)}
    ),
    "noise of other environments": swap("learner/wander", wider),
    "noise without end": swap("learner/wander", lambda t: t + torch.inf),
    "generator of another kind": swap("learner/noise", lambda t: t[:7]),
    "episodes of other environments": swap("env/next_episode", wider),
    "episodes before the first": swap("env/next_episode", lambda t: t - 1000),
    "episodes of another type": swap("env/next_episode", lambda t: t.double()),
    "nobody knows it": lambda tensors, values: tensors.update({"env/surprise": torch.zeros(1)}),
    "estimator of another shape": swap("env/trainer.cell.", wider),
    "its moments of another shape": swap("env/trainer.adam.exp_avg_sq.", wider),
    "its states of other environments": swap("env/state.x", wider),
    "its states without end": swap("env/state.R", lambda t: t * torch.inf),
    "recordings of other environments": swap("env/memory.recent.0.z", lambda t: wider(t.mT).mT),
    "recordings of other measurements": swap("env/memory.recent.0.z", lambda t: t[..., :7]),
    "recordings of another type": swap("env/memory.recent.0.started", lambda t: t.double()),
    "recordings of meshes that are not there": swap("env/memory.recent.0.mesh", lambda t: t + 10**6),
    "truth of another type": swap("env/truth", lambda t: t.double()),
    "curriculum of no number": value("climbed", "a"),
    "curriculum before its beginning": value("climbed", -5),
    "hours of no number": value("hours", "a"),
    "windows of no numbers": lambda tensors, values: values["tracker"]["window"].update({"drop": ["a"]}),
    "no generator": value("torch_rng", [0] * 7),
    "learning rate of no number": lambda tensors, values: values["learner"].update({"rate": "a"}),
    "steps of no number": lambda tensors, values: values["learner"].update({"steps": None}),
}


def test_what_is_left_as_it_was_goes_on(engine: str, run: Path, tmp_path: Path) -> None:
    play(engine, Path(shutil.copytree(run, tmp_path / "run")), STEPS + 48)


@pytest.mark.parametrize("name", FORGERIES)
def test_checkpoints_of_no_such_run_are_refused(engine: str, run: Path, tmp_path: Path, name: str) -> None:
    directory = Path(shutil.copytree(run, tmp_path / "run"))
    saved = checkpoints.newest(directory / "checkpoints")[0]
    assert saved is not None
    FORGERIES[name](saved.tensors, saved.values)
    shutil.rmtree(directory / "checkpoints")
    path = checkpoints.save(directory / "checkpoints", saved.step, saved.tensors, saved.values)
    before = (directory / "metrics.jsonl").read_bytes()
    with pytest.raises(CheckpointError, match="does not fit this run") as caught:
        play(engine, directory, STEPS + 48)
    assert str(path) in str(caught.value)
    assert (directory / "metrics.jsonl").read_bytes() == before


def pickled(directory: Path) -> None:
    data = pickle.dumps(Bomb())
    (directory / "policy.safetensors").write_bytes(data)
    manifest = json.loads((directory / "agent.json").read_text())
    manifest["weights"]["policy.safetensors"] = digest(data)
    (directory / "agent.json").write_text(json.dumps(manifest))


def another(**changes: Any) -> Callable[[Path], None]:
    def forge(directory: Path) -> None:
        manifest = json.loads((directory / "agent.json").read_text())
        (directory / "agent.json").write_text(json.dumps(merge(manifest, changes)))

    return forge


TEACHERS: dict[str, tuple[Callable[[Path], None], str]] = {
    "unpickled": (pickled, "not a safetensors file"),
    "cut": (lambda d: (d / "policy.safetensors").write_bytes(b"0") and None, "SHA-256"),
    "gone": (lambda d: (d / "agent.json").unlink(), "no such file"),
    "that feels": (another(kind="tactile"), "kind|estimator"),
    "of other actions": (another(task={"action": "absolute"}), "task.action"),
    "of other layers": (another(network={"layers": {"hidden": [8, 8]}}), "do not fit"),
    "of other observations": (another(layout=[["joints", 144]]), "layout|fit"),
}


@pytest.mark.parametrize("name", TEACHERS)
def test_teachers_made_to_harm_are_refused(engine: str, tmp_path: Path, name: str) -> None:
    forge, match = TEACHERS[name]
    teacher = Path(shutil.copytree(TEACHER, tmp_path / "teacher"))
    forge(teacher)
    with pytest.raises(AgentError, match=match) as caught:
        play(engine, tmp_path / "run", STEPS, "oracle", ppo={"teacher": str(teacher)})
    assert str(teacher) in str(caught.value)
    assert not (tmp_path / "run/metrics.jsonl").exists() and not (tmp_path / "run/agent.json").exists()
