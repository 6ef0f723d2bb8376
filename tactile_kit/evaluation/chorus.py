"""Several estimators at once on the same episodes, of an agent that is told the truth: side by side, step by step."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tactile_kit.errors import EvaluationError
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.task.observation import Belief

POSE = 12  # of a follower's part of the state: position, and orientation as a matrix


class Chorus:
    """Estimators that follow side by side, with the interface of one; its own pose is the first one's.

    Args:
        voices: estimators by name, all reading the encoding of the agent they follow. At least one.

    Attributes:
        beliefs: by name, of all environments after the last call: x ``(B, 3)`` m, R ``(B, 3, 3)``, sigma ``(B, 2)``.

    Raises:
        EvaluationError: no estimators.
    """

    def __init__(self, voices: Mapping[str, Any]) -> None:
        if not voices:
            raise EvaluationError("followers = {}; allowed are one or more estimators by name")
        self.voices = dict(voices)
        self.beliefs: dict[str, Belief] = {}
        self._widths: list[int] = []

    def beside(self, agent: Any) -> Any:
        """The agent with this beside it, to be told the truth all the same.

        Raises:
            EvaluationError: the agent has an estimator, or one here reads another encoding than the agent.
        """
        if agent.estimator is not None:
            raise EvaluationError(f"{agent.directory}: followers follow an oracle, this is a {agent.kind}")
        for name, voice in self.voices.items():
            reads = getattr(getattr(voice, "shape", None), "name", agent.task.encoding)
            if reads != agent.task.encoding:
                raise EvaluationError(
                    f"follower {name!r} reads encoding {reads!r}; allowed is the agent's, {agent.task.encoding!r}"
                )
        return agent.told_by(self)

    def initial(self, R0: Tensor) -> EstimatorState:
        """R0 ``(B, 3, 3)``; see ``EstimatorCell.initial``."""
        return self._packed([voice.initial(R0) for voice in self.voices.values()])

    @torch.no_grad()
    def __call__(self, state: EstimatorState, z: Tensor, encoding: Any, mesh: Tensor) -> EstimatorState:
        """One step of all; see ``EstimatorCell.forward``."""
        after = [
            voice(mine, z, encoding, mesh)
            for voice, mine in zip(self.voices.values(), self._unpacked(state), strict=True)
        ]
        packed = self._packed(after)
        self.beliefs = self.believed(packed)
        return packed

    @torch.no_grad()
    def believed(self, state: EstimatorState) -> dict[str, Belief]:
        """What each believes in that state of all."""
        return {
            name: Belief(mine.x.numpy(), mine.R.numpy(), voice.sigmas(mine).numpy())
            for (name, voice), mine in zip(self.voices.items(), self._unpacked(state), strict=True)
        }

    def sigmas(self, state: EstimatorState) -> Tensor:
        """Of the first: ``(B, 2)``."""
        return next(iter(self.voices.values())).sigmas(self._unpacked(state)[0])

    def _packed(self, states: list[EstimatorState]) -> EstimatorState:
        parts = [torch.cat([s.x, s.R.flatten(1), s.latent], dim=1) for s in states]
        self._widths = [part.shape[1] for part in parts]
        return EstimatorState(states[0].x, states[0].R, torch.cat(parts, dim=1))

    def _unpacked(self, state: EstimatorState) -> list[EstimatorState]:
        parts = state.latent.split(self._widths, dim=1)
        return [
            EstimatorState(part[:, :3], part[:, 3:POSE].unflatten(1, (3, 3)), part[:, POSE:])
            for part in parts
        ]


class Timed:
    """An estimator whose steps, sigmas included, are timed: CPU time of this thread, s, and number of environments."""

    def __init__(self, estimator: Any) -> None:
        self.estimator = estimator
        self.calls: list[tuple[float, int]] = []

    def __call__(self, state: EstimatorState, z: Tensor, encoding: Any, mesh: Tensor) -> EstimatorState:
        began = time.thread_time()
        after = self.estimator(state, z, encoding, mesh)
        self.estimator.sigmas(after)
        self.calls.append((time.thread_time() - began, len(z)))
        return after

    def __getattr__(self, name: str) -> Any:
        return getattr(self.estimator, name)

    def cost(self) -> dict[str, float]:
        """Median and quartiles of the µs that a step of one environment takes, over the calls with the most
        environments; how many these were, and how many calls."""
        most = max(count for _, count in self.calls)
        spent = 1e6 * np.array([seconds for seconds, count in self.calls if count == most]) / most
        low, median, high = np.quantile(spent, (0.25, 0.5, 0.75))
        return {
            "environments": most,
            "median": round(float(median), 2),
            "low": round(float(low), 2),
            "high": round(float(high), 2),
            "calls": len(spent),
        }
