"""Films: one picture a control step, the object visible, the goal in the corner."""

from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from tactile_kit.evaluation.errors import EvaluationError
from tactile_kit.evaluation.film import film
from tactile_kit.runs import RunConfig, train


@pytest.fixture(scope="module")
def agent(tmp_path_factory) -> Path:
    directory = tmp_path_factory.mktemp("agent")
    changes = {
        "steps": 32,
        "num_envs": 2,
        "num_workers": 1,
        "task.grasps": 2,
        "episodes.grasps": 2,
        "ppo.rollout": 16,
    }
    train(RunConfig.preset("ppo-smoke", changes), directory, quiet=True)
    return directory


def test_film_shows_object_and_goal(agent: Path, tmp_path: Path):
    count = film(agent, tmp_path / "a.gif", objects="cube", size=128)
    pictures = imageio.imread(tmp_path / "a.gif")
    assert len(pictures) <= count <= 100  # GIF writers merge equal neighbours
    assert pictures.shape[1:] == (128, 128, 3)
    orange = (pictures[..., 0] > 120) & (pictures[..., 2] < 80)
    corner = np.zeros(orange.shape[1:], bool)
    corner[:42, -42:] = True
    assert orange[0][corner].sum() > 20  # the goal
    assert orange[0][~corner].sum() > 20  # the object


def test_bad_film_is_refused(agent: Path, tmp_path: Path):
    with pytest.raises(EvaluationError, match=r"a\.avi.*\.gif and \.mp4"):
        film(agent, tmp_path / "a.avi")
    with pytest.raises(EvaluationError, match="multiples of 16"):
        film(agent, tmp_path / "a.gif", size=100)
