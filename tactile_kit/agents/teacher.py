"""A trained oracle that shows what it would do where a student has got to (DAgger, Ross et al. 2011).

The student may see less, or see the shape in another encoding: the teacher reads the true state of the student's
environments and builds its own observation from it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tactile_kit.agents.agent import load_agent
from tactile_kit.errors import AgentError
from tactile_kit.shape import encoding
from tactile_kit.task.observation import Belief, Observer, layout_of

RATE, LAST_RATE = 1e-3, 1e-4  # the student's learning rate while it is taught, at first and in the end
MINIBATCH = 1024  # transitions a gradient step while it is taught, at most


class Teacher:
    """An oracle's actions in the environments of ``env``.

    Args:
        directory: of a trained oracle agent, of whatever encoding.
        env: the student's ``ReorientVecEnv`` (or tactile one): its ``state``, ``meshes`` and task are read.

    Raises:
        AgentError: no valid agent, not an oracle, or its actions mean something else than the student's.
    """

    def __init__(self, directory: str | Path, env: Any) -> None:
        self.agent, self.env = load_agent(directory), env
        if self.agent.kind != "oracle":
            raise AgentError(f"{directory}: kind {self.agent.kind!r} can't teach, allowed: 'oracle'")
        theirs, ours = self.agent.task.action, env.config.action
        if theirs != ours:
            raise AgentError(
                f"{directory}: task.action {theirs!r}, the student's is {ours!r}: allowed is the same"
            )
        shape = encoding(self.agent.task.encoding, env.meshes)
        layout = layout_of(shape, pose=self.agent.task.pose_in_observation, sigma=False)
        self.observer = Observer(layout, shape)

    def actions(self) -> Tensor:
        """What it would do now, without noise: ``(E, 12) float32``."""
        state = self.env.state
        truth = Belief(state.x.astype(np.float32), state.R.astype(np.float32))
        return torch.from_numpy(self.agent.act(self.observer(state.z, state.goal, truth, state.given)))


class Lessons:
    """A student's first ``steps`` environment steps, in which it only follows its teacher, and not yet its returns."""

    def __init__(self, teacher: Teacher, steps: int) -> None:
        self.teacher, self.steps = teacher, steps

    def go_on(self, step: int) -> bool:
        """Whether they last still after so many environment steps."""
        return self.steps > 0 and step <= self.steps

    def learning_rate(self, step: int) -> float:
        """The student's: falls by equal factors."""
        return RATE * (LAST_RATE / RATE) ** min(step / self.steps, 1.0)

    def led(self, step: int, num_envs: int) -> Tensor:
        """``(E,) bool``: where the teacher's action is executed: everywhere at first, nowhere from half-way on."""
        return torch.arange(num_envs) < max(1.0 - 2.0 * (step / self.steps), 0.0) * num_envs

    def show(self, mean: Tensor, step: int) -> tuple[Tensor, Tensor]:
        """The teacher's actions, and those in place of the student's ``mean`` where it leads; ``(E, A)`` each."""
        shown = self.teacher.actions()
        return shown, torch.where(self.led(step, len(mean))[:, None], shown, mean)
