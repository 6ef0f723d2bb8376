"""A run in progress: everything that a checkpoint holds, saved and taken up again."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tactile_kit.agents.state import pack, unpack
from tactile_kit.errors import CheckpointError
from tactile_kit.runs import checkpoint as checkpoints
from tactile_kit.runs.calm import Calm
from tactile_kit.runs.config import RunConfig
from tactile_kit.runs.directory import versions
from tactile_kit.runs.export import export_agent
from tactile_kit.runs.fitting import require_tensors, require_values
from tactile_kit.runs.metrics import Tracker


@dataclass
class Run:
    """A run in progress: what is saved, beside learner and environment."""

    config: RunConfig
    directory: Path
    learner: Any
    env: Any
    tracker: Tracker
    hours: float = 0.0  # trained so far
    warm_start: dict[str, Any] | None = None
    evaluation: dict[str, Any] | None = None  # the last held-out one
    line: dict[str, Any] = field(default_factory=dict)  # the last line of metrics
    logged: int = 0  # environment steps at that line
    gravity: float | None = None  # last told to the environment
    calm: Calm = field(init=False)
    climbed: int = 0  # environment steps that count for the gravity curriculum
    seen: int = 0  # environment steps when they were counted last

    def __post_init__(self) -> None:
        self.calm = Calm(self.config.calm)

    @property
    def over(self) -> bool:
        """Whether nothing is left to train: the steps are done, or success has levelled off for good."""
        return self.calm.over or self.learner.num_timesteps >= self.config.steps

    def save(self) -> None:
        """A checkpoint of everything, then the exported agent. Raises OSError."""
        tensors, body = self.state()
        folder = self.directory / "checkpoints"
        checkpoints.save(folder, self.learner.num_timesteps, tensors, body, self.config.checkpoint.keep)
        self.export()

    def state(self) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
        """All that a checkpoint holds: tensors, and values for JSON."""
        tensors, values = self.learner.state()
        body: dict[str, Any] = {
            "learner": values,
            "tracker": self.tracker.state(),
            "config": self.config.to_dict(),
            "versions": dict(versions()),
            "hours": self.hours,
            "warm_start": self.warm_start,
            "evaluation": self.evaluation,
            "line": self.line,
            "logged": self.logged,
            "climbed": self.climbed,
            "seen": self.seen,
            "calm": self.calm.state(),
            "torch_rng": torch.get_rng_state().tolist(),
        }
        tensors = {f"learner/{name}": tensor for name, tensor in tensors.items()}
        if hasattr(self.env, "get_state"):
            arrays, body["env"] = _split(self.env.get_state())
            tensors |= pack("env", {name: torch.from_numpy(array) for name, array in arrays.items()})
        return tensors, body

    def export(self) -> None:
        """The agent as it is now."""
        export_agent(
            self.directory,
            self.config,
            self.learner,
            hours=self.hours,
            training=self.line,
            evaluation=self.evaluation,
            warm_start=self.warm_start,
            levelled=self.calm.over,
        )

    def restore(self, saved: checkpoints.Checkpoint) -> None:
        """Take up the state of a checkpoint, before anything is played. Raises CheckpointError when it does not fit."""
        values = saved.values
        try:
            tensors, body = self.state()
            require_tensors(tensors, saved.tensors)
            require_values({name: body[name] for name in body.keys() - {"config", "versions"}}, values)
            self.learner.restore(unpack("learner", saved.tensors), values["learner"])
            self.tracker.restore(values["tracker"])
            if "env" in values and hasattr(self.env, "set_state"):
                arrays = {name: tensor.numpy() for name, tensor in unpack("env", saved.tensors).items()}
                self.env.set_state({**arrays, **values["env"]})
            torch.set_rng_state(torch.tensor(values["torch_rng"], dtype=torch.uint8))
            for name in ("hours", "warm_start", "evaluation", "line", "logged", "climbed", "seen"):
                setattr(self, name, values[name])
            self.calm.restore(values["calm"])
        except (KeyError, TypeError, ValueError, RuntimeError) as problem:
            raise CheckpointError(f"{saved.path}: does not fit this run: {problem}") from problem

    def steer(self) -> None:
        """Gravity and noise as what was measured so far asks for them, for the episodes to come."""
        self._apply_gravity()
        rho, settled = getattr(self.env, "rho", 0.0), self.gravity == self.config.gravity.end
        settled = settled and self.learner.leads and not rho
        self.calm.look(settled, self.learner.num_timesteps, self.tracker.episodes, self.tracker.successes)
        if self.calm.log_std is not None:
            self.learner.ceiling = self.calm.log_std
        if hasattr(self.env, "slow"):
            self.env.slow(self.calm.slowed)

    def _apply_gravity(self) -> None:
        step = self.learner.num_timesteps
        self.climbed = self.config.gravity.after(self.climbed, step - self.seen, self.tracker.drops)
        self.seen = step
        wanted = self.config.gravity.at(self.climbed)
        if wanted != self.gravity:
            self.gravity = wanted
            self.env.set_gravity(wanted)

    def begin_episodes(self) -> None:
        """Start all environments afresh.

        A physics engine's inner state cannot be saved, so every checkpoint is a boundary between episodes, for the run
        that goes on as for one that resumes: both continue with the same episodes.
        """
        self.steer()
        learner = self.learner
        learner._last_obs = self.env.reset()
        learner._last_episode_starts = np.ones(self.env.num_envs, dtype=bool)


def _split(state: dict[str, Any]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays for safetensors, the rest for JSON."""
    arrays = {name: value for name, value in state.items() if isinstance(value, np.ndarray)}
    return arrays, {name: value for name, value in state.items() if name not in arrays}
