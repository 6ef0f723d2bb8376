"""The same seed gives the same episodes, byte for byte, whatever runs before, beside or in how many processes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import episodes
import numpy as np
import pytest
from episodes import Play

from tactile_kit.agents.agent import load_agent
from tactile_kit.evaluation import evaluate, write_rows
from tactile_kit.task.actions import ActionError
from tactile_kit.task.env import ReorientEnv
from tactile_kit.task.goals import training_episodes

AGENTS = Path(__file__).parents[2] / "results/agents"


@pytest.fixture(scope="module", params=["bullet", "compiled"])
def engine(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def reference(engine: str) -> str:
    play = Play(engine=engine)
    digest = play.digest()
    assert play.ended >= 2 * episodes.ENVIRONMENTS
    assert Play(seed=8, engine=engine).digest() != digest
    return digest


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_workers_change_nothing(reference: str, engine: str, workers: int) -> None:
    assert Play(workers=workers, engine=engine).digest() == reference


def test_a_new_process_changes_nothing(reference: str, engine: str) -> None:
    command = [sys.executable, episodes.__file__, "1", engine]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert run.stdout.split()[-1] == reference


def test_environments_in_one_process_leave_each_other_alone(reference: str, engine: str) -> None:
    one, other = Play(engine=engine), Play(seed=8, engine=engine)
    for number in range(episodes.STEPS):
        one.step()
        other.step(nonsense=number == 5)
    one.env.close()
    other.env.close()
    assert one.shown.hexdigest() == reference


def test_fifty_other_episodes_change_nothing() -> None:
    """Of other objects, dropped, ended by time and left where an action was refused."""
    env = ReorientEnv(episodes.TASK)
    specs = training_episodes(episodes.TASK, env.core.variants, 0, seed=5)
    spec, ends = next(specs), {"drop": 0, "refused": 0, "time": 0}

    def play(spec, number: int) -> list[bytes]:
        actions = np.random.default_rng(number).uniform(-0.6, 0.2, (10, 12)) - 0.6 * (number % 3 == 1)
        if number % 7 == 6:
            actions[4, 3] = np.inf
        shown = [env.reset(options={"episode": spec})[0].tobytes()]
        for action in actions:
            try:
                observation, reward, terminated, truncated, info = env.step(action)
            except ActionError:
                ends["refused"] += 1
                return shown
            shown += [observation.tobytes(), np.float64(reward).tobytes()]
            if terminated or truncated:
                ends["drop" if info["drop"] else "time"] += 1
                return shown
        raise AssertionError("the episode did not end")

    before = play(spec, 0)
    others = [play(next(specs), number) for number in range(1, 51)]
    after = play(spec, 0)
    env.close()
    assert before == after and all(other != before for other in others)
    assert min(ends.values()) >= 5


EVALUATE = """
import sys
from tactile_kit.evaluation import evaluate, write_rows
write_rows(sys.argv[2], evaluate(sys.argv[1], "cube,apple", goals_per_case=2, num_envs=4, num_workers=2, seed=3))
"""


@pytest.mark.parametrize("name", ["oracle-vec_bps-geometric8-s0", "tactile-vec_bps-geometric8-s0"])
def test_a_shipped_agent_is_evaluated_alike_every_time(tmp_path: Path, name: str) -> None:
    settings = {"objects": "cube,apple", "goals_per_case": 2, "num_envs": 4, "num_workers": 0, "seed": 3}
    agent = load_agent(AGENTS / name)
    for turn in ("first", "again"):
        write_rows(tmp_path / turn, evaluate(agent, **settings))
    command = [sys.executable, "-c", EVALUATE, str(AGENTS / name), str(tmp_path / "elsewhere")]
    subprocess.run(command, capture_output=True, text=True, timeout=200, check=True)
    first, *others = ((tmp_path / turn).read_bytes() for turn in ("first", "again", "elsewhere"))
    assert others == [first, first] and first.count(b"\n") == 5
