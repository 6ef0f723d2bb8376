"""A fault amid a training: counted, reported, kept on disk, played again, and nothing wrong is learned from it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from promise_cases import settings

from tactile_kit.ecrl import TactileVecEnv
from tactile_kit.runs import RunConfig, read_metrics, train
from tactile_kit.runs import checkpoint as checkpoints
from tactile_kit.simulation.dump import read
from tactile_kit.simulation.episode import Status
from tactile_kit.simulation.replay import replay
from tactile_kit.task.core import Core


class Failing(TactileVecEnv):
    """Now and then an object is thrown out of the hand."""

    steps = 0

    def step_async(self, actions: np.ndarray) -> None:
        self.steps += 1
        if self.steps % 15 == 5:
            world = self.simulation.simulators[1].world
            world.bullet.resetBaseVelocity(world.object, [0, 300, 0], [0, 0, 0])
        if self.steps % 15 == 11:
            actions = actions.copy()
            actions[2, 4] = np.nan
        super().step_async(actions)


def failing(config: RunConfig) -> Any:
    return Failing(
        config.task,
        num_envs=config.num_envs,
        num_workers=0,
        seed=1,
        estimator=config.estimator,
        ecrl=config.ecrl,
    )


def test_faults_in_a_training(tmp_path: Path) -> None:
    config = settings("tactile", 192)
    train(config, tmp_path, make_env=failing, quiet=True)
    last = read_metrics(tmp_path)[-1]
    files = sorted((tmp_path / "faults").iterdir())
    assert len(files) >= 6 and round(last["faults"] * last["episodes"]) == len(files)
    saved = checkpoints.newest(tmp_path / "checkpoints")[0]
    assert saved is not None
    for name, tensor in saved.tensors.items():
        assert not tensor.is_floating_point() or torch.isfinite(tensor).all(), name
    dumps = [read(file) for file in files]
    assert {dump.fault.split()[0] for dump in dumps} == {"object", "action"}
    simulator = Core(config.task, sigma=True).blueprint.build()
    for dump in dumps:
        if dump.fault.startswith("action"):  # what was done to Bullet from outside is not in any file
            assert replay(dump, simulator) == Status.FAULT and simulator.fault == dump.fault
    simulator.close()
