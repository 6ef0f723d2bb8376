"""Exploration noise that lasts: fingers let go and reach elsewhere only if the noise points one way for a while."""

from __future__ import annotations

import torch

from tactile_kit.agents.config import ExplorationConfig
from tactile_kit.hand.kinematics import DRIVEN

SWITCH = 0.1  # chance an action that an environment's moving fingers are drawn anew: a second on average
CALM = 0.3  # noise of the other fingers meanwhile


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

    def state(self) -> dict[str, torch.Tensor]:
        """What :meth:`restore` needs; empty before the first draw."""
        return {} if self.noise is None else {"noise": self.noise.clone(), "reach": self.reach.clone()}

    def restore(self, state: dict[str, torch.Tensor]) -> None:
        """Inverse of :meth:`state`."""
        self.noise = state["noise"].clone() if state else None
        self.reach = state["reach"].clone() if state else torch.ones(0)
