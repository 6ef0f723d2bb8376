"""A whole training that is given demonstrations, as its settings name them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tactile_kit.agents import load_agent
from tactile_kit.planning.demonstrations import DemonstrationError
from tactile_kit.runs import RunConfig, train

TINY = {"hidden": (16,)}
LEARNERS = {
    "sac": {"warmup": 4, "batch": 8, "clone": 1.0, "demonstration_share": 0.5},
    "ppo": {"rollout": 8, "minibatch": 8, "epochs": 1, "clone": 1.0, "clone_epochs": 2, "critic_steps": 8},
}


def config(algorithm: str, directory: Path) -> RunConfig:
    learner = {"actor": TINY, "critic": TINY, "demonstrations": str(directory), **LEARNERS[algorithm]}
    changes = {
        "steps": 32, "num_envs": 2, "encoding": "none", "log_every": 16, algorithm: learner,
        "task": {"objects": "cube", "horizon": 8, "grasps": 2}, "evaluation": {"minutes": 0},
    }  # fmt: skip
    return RunConfig.preset(f"{algorithm}-smoke", changes)


@pytest.mark.parametrize(
    ("algorithm", "said"), [("sac", "demonstrated transitions"), ("ppo", "imitation 2/2")]
)
def test_a_training_begins_with_its_demonstrations(
    algorithm: str, said: str, demonstrations: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    train(config(algorithm, demonstrations), tmp_path)
    assert said in capsys.readouterr().err
    assert load_agent(tmp_path).manifest.steps == 32


def test_a_folder_without_demonstrations_is_told(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(DemonstrationError, match=r"empty.*no demonstrations"):
        train(config("sac", tmp_path / "empty"), tmp_path / "run", quiet=True)
