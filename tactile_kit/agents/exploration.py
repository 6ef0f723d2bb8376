"""Exploration that lasts: fingers let go and reach elsewhere only if the noise points one way for a while.

Two ways of it: noise that is correlated in time and at times moves one or two fingers only, and whole regrasps, in
which one finger lifts, moves sideways and closes again while the policy goes on with the others.
"""

from __future__ import annotations

import torch

from tactile_kit.agents.config import ExplorationConfig
from tactile_kit.hand.kinematics import DRIVEN

SWITCH = 0.1  # chance an action that an environment's moving fingers are drawn anew: a second on average
CALM = 0.3  # noise of the other fingers meanwhile

LIFT = (0.15, 0.6)  # how far q2 opens, in action units of 0.92 rad; q3 half as far
PHASES = (2, 5)  # actions of each of the three phases: up, sideways, down


class Exploration:
    """Standard normal noise ``(E, A)``, correlated in time, at times on one or two fingers only and then larger.

    Args:
        config: settings.
        actions: A, three for each finger.
        generator: of everything drawn here.
    """

    def __init__(self, config: ExplorationConfig, actions: int, generator: torch.Generator) -> None:
        if config.few_fingers and actions % DRIVEN:
            raise ValueError(
                f"exploration.few_fingers = {config.few_fingers}: {actions} actions are no whole fingers"
            )
        self.config, self.actions, self.generator = config, actions, generator
        self.noise: torch.Tensor | None = None
        self.reach = torch.ones(0)
        self.clock = torch.zeros(0, dtype=torch.long)  # actions left of a regrasp, 0: none
        self.finger = torch.zeros(0, dtype=torch.long)
        self.ends = torch.zeros(0, 2, dtype=torch.long)  # the clock at which going up and sideways end
        self.poses = torch.zeros(0, 3, DRIVEN)  # of the finger, in the three phases

    def draw(self, environments: int) -> torch.Tensor:
        """The noise of the next action of every environment."""
        config, generator = self.config, self.generator
        fresh = torch.randn(environments, self.actions, generator=generator)
        if self.noise is None:
            self.noise, self.reach = fresh, torch.ones_like(fresh)
        else:
            keep = config.correlation
            self.noise = keep * self.noise + (1 - keep**2) ** 0.5 * fresh
        if config.few_fingers:
            self._switch(environments)
        return self.noise * self.reach

    def _switch(self, environments: int) -> None:
        chance = torch.rand(environments, 3, generator=self.generator)
        order = torch.rand(environments, self.actions // DRIVEN, generator=self.generator).argsort(1)
        moved = order < 1 + (chance[:, 2:] < 0.5).int()
        few = torch.where(moved, self.config.few_reach, CALM)
        reach = torch.where(chance[:, 1:2] < self.config.few_fingers, few, 1.0).repeat_interleave(DRIVEN, 1)
        self.reach = torch.where(chance[:, :1] < SWITCH, reach, self.reach)

    def regrasp(self, actions: torch.Tensor) -> torch.Tensor:
        """The policy's actions ``(E, A)``, with one finger's replaced where a regrasp is under way."""
        if not self.config.regrasps:
            return actions
        fingers = actions.reshape(len(actions), -1, DRIVEN)
        if not len(self.clock):
            self._rest(len(actions))
        self._begin(fingers)
        under = self.clock > 0
        phase = (self.clock[:, None] <= self.ends).sum(1)
        rows = torch.arange(len(actions))
        replaced = fingers.clone()
        replaced[rows, self.finger] = torch.where(
            under[:, None], self.poses[rows, phase], fingers[rows, self.finger]
        )
        self.clock = (self.clock - 1).clamp_min(0)
        return replaced.reshape_as(actions)

    def _rest(self, environments: int) -> None:
        self.clock = torch.zeros(environments, dtype=torch.long)
        self.finger = torch.zeros(environments, dtype=torch.long)
        self.ends = torch.zeros(environments, 2, dtype=torch.long)
        self.poses = torch.zeros(environments, 3, DRIVEN)

    def _begin(self, fingers: torch.Tensor) -> None:
        count, generator = len(fingers), self.generator
        starts = (torch.rand(count, generator=generator) < self.config.regrasps) & (self.clock == 0)
        finger = torch.randint(fingers.shape[1], (count,), generator=generator)
        lengths = torch.randint(PHASES[0], PHASES[1], (count, 3), generator=generator)
        chance = torch.rand(count, 2, generator=generator)
        lift = LIFT[0] + (LIFT[1] - LIFT[0]) * chance[:, 0]
        now = fingers[torch.arange(count), finger]
        up, aside, down = now.clone(), now.clone(), now.clone()
        up[:, 1], up[:, 2] = now[:, 1] - lift, now[:, 2] - 0.5 * lift
        aside[:, 1:], aside[:, 0] = up[:, 1:], 2.0 * chance[:, 1] - 1.0
        down[:, 0] = aside[:, 0]
        down[:, 1:] += 0.1 * torch.randn(count, 2, generator=generator)
        poses = torch.stack([up, aside, down], dim=1).clamp(-1.0, 1.0)
        ends = torch.stack([lengths[:, 1] + lengths[:, 2], lengths[:, 2]], dim=1)
        self.clock = torch.where(starts, lengths.sum(1), self.clock)
        self.finger = torch.where(starts, finger, self.finger)
        self.ends = torch.where(starts[:, None], ends, self.ends)
        self.poses = torch.where(starts[:, None, None], poses, self.poses)

    def state(self) -> dict[str, torch.Tensor]:
        """What :meth:`restore` needs; empty before the first draw."""
        if self.noise is None:
            return {}
        names = ("noise", "reach", "clock", "finger", "ends", "poses")
        return {name: getattr(self, name).clone() for name in names}

    def restore(self, state: dict[str, torch.Tensor]) -> None:
        """Inverse of :meth:`state`."""
        for name, value in state.items():
            setattr(self, name, value.clone())
