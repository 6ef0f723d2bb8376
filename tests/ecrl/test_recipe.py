"""The recipe of the tactile agents, small, with all that it uses: stages, averaging, a critic that sees the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from tactile_kit.agents import load_agent
from tactile_kit.agents.manifest import read_manifest
from tactile_kit.evaluation import EvaluationError
from tactile_kit.evaluation.estimates import Followed, follow
from tactile_kit.files import read_tensors
from tactile_kit.runs import RunConfig, train
from tactile_kit.runs.metrics import read_metrics

pytestmark = pytest.mark.slow

LAYERS = {"hidden": (32, 32)}
ROLLOUT = 16 * 8  # steps of one roll-out
SMALL = {
    "num_envs": 16,
    "log_every": ROLLOUT,
    "scaling": "nominal",
    "task": {"objects": "cube", "horizon": 12, "grasps": 2},
    "episodes": {"grasps": 2, "grasp_spread": 0.0},
    "evaluation": {"minutes": 0},
    "ppo": {"rollout": 8, "minibatch": 64, "actor": LAYERS, "critic": LAYERS},
}


def tree(source: Path, steps: int, fixed: int, critic: int, **changes) -> RunConfig:
    settings = {
        **SMALL,
        "steps": steps,
        "warm_start": str(source),
        "ppo": SMALL["ppo"] | {"fixed_steps": fixed, "critic_steps": critic, "log_std": -2.2},
        "estimator": {"transition_hidden": (32,), "sigma_hidden": (16,), "minibatch": 8},
        "ecrl": {"rollout": 4, "rho_start": 0.5, "rho_step": 0.05, "critic_sees_truth": True},
    }
    return RunConfig.preset("tactile-compiled", settings | changes)


@pytest.fixture(scope="module")
def oracle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = {**SMALL, "steps": 2 * ROLLOUT, "gravity": {"start": 9.81, "steps": 0}}
    return train(RunConfig.preset("ppo-compiled", settings), tmp_path_factory.mktemp("oracle"), quiet=True)


@pytest.fixture(scope="module")
def tactile(oracle: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    config = tree(oracle, 6 * ROLLOUT, 2 * ROLLOUT, 2 * ROLLOUT)
    return train(config, tmp_path_factory.mktemp("tactile"), quiet=True)


def weights(directory: Path, name: str) -> dict[str, torch.Tensor]:
    return read_tensors(directory / name, read_manifest(directory).weights[name])


def test_at_first_only_the_estimator_learns_then_the_critic_then_all(oracle: Path, tmp_path: Path) -> None:
    actors, critics, cells = [], [], []
    for number, steps in enumerate((1, 2, 4, 6)):
        config = tree(oracle, steps * ROLLOUT, 2 * ROLLOUT, 2 * ROLLOUT)
        train(config, tmp_path / "run", quiet=True)  # goes on with the run, whose steps may grow
        actors.append(weights(tmp_path / "run", "policy.safetensors")["mean.weight"])
        critics.append(weights(tmp_path / "run", "critic.safetensors")["head.weight"])
        cells.append(weights(tmp_path / "run", "estimator.safetensors")["transition.0.weight"])
        assert number == 0 or not torch.equal(cells[-1], cells[-2])
    assert torch.equal(actors[0], actors[1]) and torch.equal(actors[1], actors[2])
    assert not torch.equal(actors[2], actors[3])
    assert torch.equal(critics[0], critics[1])
    assert not torch.equal(critics[1], critics[2])
    assert torch.equal(actors[0], weights(oracle, "policy.safetensors")["mean.weight"])


def test_figures_tell_of_beliefs(tactile: Path) -> None:
    last = read_metrics(tactile)[-1]
    assert {
        "fed/off",
        "fed/turn",
        "fed/drops",
        "estimator/angle_error",
        "estimator/lost",
        "rho",
    } <= last.keys()
    assert 0 < last["fed/turn"] < 1 and 0 < last["fed/off"] < np.pi


def test_the_agent_acts_on_what_it_feels_and_its_estimator_is_measured(tactile: Path, oracle: Path) -> None:
    agent = load_agent(tactile)
    assert [name for name, _ in agent.manifest.layout] == ["joints", "goal", "shape", "pose", "sigma"]
    told, fed = (follow(agent, "cube", truth=truth, episodes=6, seed=2) for truth in (True, False))
    for followed in (told, fed):
        figures = followed.figures()
        assert figures["episodes"] == 6 and figures["mean"] > 0 and figures["calibration"] > 0
        assert not np.isnan(followed.angle[followed.held]).any()
        assert np.isnan(followed.angle[~followed.held]).all()
        # what an untrained estimator believes is where the object was; told or not, the first step is nearly the same
        assert followed.angle[0].max() < 0.5
    again = follow(agent, "cube", truth=True, episodes=6, seed=2)
    np.testing.assert_array_equal(again.angle, told.angle)
    with pytest.raises(EvaluationError, match="an oracle has no estimator"):
        follow(load_agent(oracle), "cube", truth=True)


def test_figures_of_followed_episodes() -> None:
    angle = np.full((100, 2), 0.2)
    angle[50:, 1] = np.nan  # dropped after 5 s
    held = ~np.isnan(angle)
    followed = Followed(angle, angle, 0.5 * angle, angle, angle, held, np.array([3, 5]))
    figures = followed.figures()
    assert figures["mean"] == pytest.approx(0.2) and figures["calibration"] == pytest.approx(2.0)
    assert figures["within_10s"] == figures["reached"] == 1.0 and figures["lost_10s"] == 0.0
    assert figures["success"] == figures["drops"] == 0.5
    assert "within_10s" not in followed.of([5]).figures()
    with pytest.raises(EvaluationError, match="no step was played"):
        followed.of([7]).figures()


def test_the_command_trains_an_estimator_alone(oracle: Path, tmp_path: Path, capsys, monkeypatch) -> None:
    from reproduce import estimator
    from reproduce.cli import main

    known = estimator.settings_of(oracle, 2 * ROLLOUT, "paper", "likelihood", True, 4)
    assert (known.kind, known.ppo.fixed_steps, known.ecrl.rho_start) == ("tactile", 2 * ROLLOUT, 0.0)
    assert known.task.objects == "cube" and known.seed == 4
    assert (known.estimator.cell, known.estimator.loss) == ("paper", "likelihood")
    small = tree(oracle, 2 * ROLLOUT, 2 * ROLLOUT, 0)
    monkeypatch.setattr(estimator, "settings_of", lambda *arguments: small)
    steps = ["--steps", str(2 * ROLLOUT), "--agent", str(oracle), "--out", str(tmp_path / "e")]
    assert main(["train-estimator", *steps]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("All") and "512" in line for line in lines)
    measured = [
        "measure-estimator",
        "--agent",
        str(tmp_path / "e"),
        "--objects",
        "cube,gear",
        "--episodes",
        "4",
    ]
    assert main([*measured, "--each"]) == 0
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()[1:]]
    assert names == ["All", "cube", "gear"]
