"""Ray actors in place of worker processes: the same bytes, also where one is lost."""

from __future__ import annotations

import os
import signal
import warnings
from collections.abc import Iterator

import numpy as np
import pytest

import randomization
import tactile_kit
from tactile_kit.errors import EngineError
from tactile_kit.simulation.vector import WorkerError

ray = pytest.importorskip("ray", reason="the extra ray is not installed")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

ENVIRONMENTS, STEPS = 4, 40


@pytest.fixture(scope="module")
def machines() -> Iterator[None]:
    """A Ray of this machine, as small as it can be."""
    for last in (False, False, True):
        try:  # a machine with other work may need more than Ray's 30 s
            ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, object_store_memory=80_000_000)
            break
        except Exception:
            ray.shutdown()
            if last:
                raise
    yield
    ray.shutdown()


def made(workers: str, number: int):
    return tactile_kit.make_vec(
        objects="cube", grasps=4, num_envs=ENVIRONMENTS, num_workers=number, workers=workers, seed=3
    )


def played(env, lose_at: int | None = None) -> list[bytes]:
    """Observations, rewards and ends of some steps; before one of them an actor may be killed."""
    rng = randomization.stream(0, "test", "actions")
    seen = [env.reset().tobytes()]
    for step in range(STEPS):
        if step == lose_at:
            victim = ray.get(env.simulation._actors[1].__ray_call__.remote(lambda actor: os.getpid()))
            os.kill(victim, signal.SIGKILL)
        observations, rewards, ends, _ = env.step(rng.uniform(-1, 1, (ENVIRONMENTS, 12)).astype(np.float32))
        seen.append(observations.tobytes() + rewards.tobytes() + ends.tobytes())
    return seen


@pytest.fixture(scope="module")
def here() -> list[bytes]:
    """Played in this process."""
    env = made("processes", 0)
    seen = played(env)
    assert env.episode_count > 2  # episodes ended and began
    env.close()
    return seen


def test_the_same_bytes(machines: None, here: list[bytes]) -> None:
    env = made("ray", 2)
    assert played(env) == here and env.simulation.replaced == 0
    env.close()
    with pytest.raises(WorkerError, match="closed"):
        env.reset()


def test_a_lost_actor_is_replaced_and_nobody_notices(machines: None, here: list[bytes]) -> None:
    env = made("ray", 2)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert played(env, lose_at=25) == here
    assert env.simulation.replaced == 1
    assert any("worker 1 was lost and is replaced" in str(one.message) for one in caught)
    env.close()


def test_refusals(machines: None) -> None:
    with pytest.raises(EngineError, match="workers = 'rai': unknown"):
        made("rai", 2)
    with pytest.raises(EngineError, match="allowed with an engine of worker processes"):
        tactile_kit.make_vec(
            objects="cube", grasps=4, num_envs=2, workers="ray", simulation={"engine": "compiled"}
        )
    with pytest.raises(ValueError, match="allowed are 1 to the 4"):
        made("ray", 5)
