"""What stands between simulator and policy: runs the estimator, lends it to the policy, and trains it on the way.

Independent of the simulator, so that it can be tested and reused without one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from randomization import stream
from tactile_kit.ecrl.config import ECRLConfig, Schedule
from tactile_kit.ecrl.memory import Memory
from tactile_kit.errors import EstimatorError
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.estimator.trainer import EstimatorTrainer

Array = NDArray[np.floating]


class Coupling:
    """Estimator states of E environments, with recording and training.

    The order of calls: ``start`` for the environments that begin an episode, then per step ``update`` for all of
    them (with the terminal measurements where an episode ends) and ``start`` again where one begins. ``pose`` gives
    what the policy is told at any time between.

    Args:
        estimator: ``EstimatorCell``, or anything with its ``initial``, call and ``sigmas`` (``KalmanFilter``).
        encoding: the estimator's shape encoding.
        trainer: trains ``estimator``; None for an estimator that doesn't learn.
        seed: of the draws between truth and estimate.

    Attributes:
        training: whether steps are recorded, the estimator is trained, and truth may stand in for estimates.
        state: estimator state of all environments.
        truth: ``(E,) bool``, episodes in which the policy is told the truth.
        told: whether the next episodes are, whatever the schedule says; None: as it says.
    """

    def __init__(
        self,
        estimator: Any,
        encoding: Any,
        trainer: EstimatorTrainer | None,
        config: ECRLConfig,
        num_envs: int,
        seed: int,
    ) -> None:
        self.estimator, self.encoding, self.trainer, self.config = estimator, encoding, trainer, config
        self.num_envs, self.seed, self.training = num_envs, seed, trainer is not None
        self.schedule = Schedule(config.rho_start, config.rho_step)
        self.memory = Memory(config.rollout, config.kept)
        with torch.no_grad():
            self.state: EstimatorState = estimator.initial(torch.eye(3).repeat(num_envs, 1, 1))
        self.truth = np.zeros(num_envs, dtype=bool)
        self._episodes = np.zeros(num_envs, dtype=np.int64)
        self._fresh = torch.ones(num_envs, dtype=torch.bool)
        self._x, self._R = torch.zeros(num_envs, 3), torch.eye(3).repeat(num_envs, 1, 1)
        self._measured: dict[str, float] = {}
        self.told: bool | None = None

    @property
    def iteration(self) -> int:
        """Trainings so far."""
        return self.trainer.iteration if self.trainer else 0

    @property
    def rho(self) -> float:
        """Probability that an episode starting now shows the policy the truth; 0 without training, unless ``told``."""
        if self.told is not None:
            return float(self.told)
        return self.schedule.at(self.iteration) if self.training else 0.0

    @property
    def true_pose(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """``(E, 3)`` m and ``(E, 3, 3)``, of the objects after the last step."""
        return self._x.numpy(), self._R.numpy()

    def start(self, which: NDArray[np.bool_], x: Array, R: Array, R0: Array) -> None:
        """Begin an episode in the environments ``which (E,)``: true pose x, R, and the orientation R0 given.

        Arrays ``(E, 3)`` m and ``(E, 3, 3)``; rows of other environments are ignored.
        """
        mask = torch.from_numpy(np.asarray(which, dtype=bool))
        with torch.no_grad():
            self.state = self.state.replaced(mask, self.estimator.initial(_tensor(R0)))
        self._fresh = self._fresh | mask
        self._x = torch.where(mask[:, None], _tensor(x), self._x)
        self._R = torch.where(mask[:, None, None], _tensor(R), self._R)
        rho = self.rho
        for environment in np.flatnonzero(which):
            draw = stream(
                self.seed, "ecrl", "truth", int(environment), int(self._episodes[environment])
            ).random()
            self.truth[environment] = draw < rho
            self._episodes[environment] += 1

    def update(
        self, z: Array, given: NDArray[np.int64], x: Array, R: Array, valid: NDArray[np.bool_] | None = None
    ) -> None:
        """One step of all environments: measurements ``(E, 144)``, mesh given ``(E,)``, true pose after the step.

        ``valid (E,) bool`` is unset where the physics failed: such a step has no measurements, the estimate stays,
        and its episode must end there. Trains when a roll-out is complete.
        """
        usable = (
            torch.ones(self.num_envs, dtype=torch.bool)
            if valid is None
            else torch.tensor(valid, dtype=torch.bool)
        )
        measured, mesh = (
            torch.where(usable[:, None], _tensor(z), 0.0),
            torch.as_tensor(given, dtype=torch.int64),
        )
        before, x_true, R_true = self.state, _tensor(x), _tensor(R)
        with torch.no_grad():
            self.state = before.replaced(usable, self.estimator(before, measured, self.encoding, mesh))
        if self.training and self.trainer is not None:
            row = {
                "z": measured,
                "mesh": mesh.clone(),
                "started": self._fresh,
                "x_before": self._x,
                "R_before": self._R,
                "x": x_true,
                "R": R_true,
                "valid": usable,
            }
            if self.memory.add(before, row):
                recorded = len(self.memory.recent[-1])
                self._measured = self.trainer.train(self.memory.recent, self.config.reuse * recorded)
        self._fresh = torch.zeros(self.num_envs, dtype=torch.bool)
        self._x, self._R = x_true, R_true

    def pose(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """What the policy is told: x ``(E, 3)``, R ``(E, 3, 3)``, sigma ``(E, 2)``.

        Truth in the episodes drawn for it, else the estimate. Sigma is always the estimator's: it describes the
        estimate that runs beside the truth, so that its meaning for the policy doesn't change with rho.
        """
        with torch.no_grad():
            sigma = self.estimator.sigmas(self.state).numpy()
        x, R = self.state.x.detach().numpy(), self.state.R.detach().numpy()
        x = np.where(self.truth[:, None], self._x.numpy(), x)
        R = np.where(self.truth[:, None, None], self._R.numpy(), R)
        return x, R, sigma

    def metrics(self) -> dict[str, float]:
        """``rho``, ``estimator/iteration`` and the last training's means (see ``EstimatorTrainer.train``)."""
        trained = {f"estimator/{name}": value for name, value in self._measured.items()}
        return {"rho": self.rho, "estimator/iteration": float(self.iteration)} | trained

    def get_state(self) -> dict[str, NDArray]:
        """Everything that a continuation needs, as named arrays: weights, Adam, roll-outs, states, counters."""
        flat: dict[str, Tensor] = {f"state.{name}": part for name, part in self.state._asdict().items()}
        flat |= {"fresh": self._fresh, "x": self._x, "R": self._R}
        flat |= {f"memory.{name}": value for name, value in self.memory.tensors().items()}
        if self.trainer is not None:
            flat |= {f"trainer.{name}": value for name, value in self.trainer.state_tensors().items()}
        arrays = {name: value.detach().numpy().copy() for name, value in flat.items()}
        arrays |= {"truth": self.truth.copy(), "episodes": self._episodes.copy()}
        return arrays | {f"measured.{name}": np.array(value) for name, value in self._measured.items()}

    def set_state(self, arrays: dict[str, NDArray]) -> None:
        """Inverse of :meth:`get_state`. Raises EstimatorError if the arrays are of other environments or sizes."""
        count = len(arrays.get("truth", ()))
        if count != self.num_envs:
            raise EstimatorError(f"coupling state of {count} environments, allowed: {self.num_envs}")
        flat = {name: torch.from_numpy(np.array(value)) for name, value in arrays.items()}
        if self.trainer is not None:
            self.trainer.load_state_tensors(_below(flat, "trainer."))
        self.state = EstimatorState(**_below(flat, "state."))
        self.memory.load_tensors(_below(flat, "memory."), count, len(self.encoding.meshes))
        self._fresh, self._x, self._R = flat["fresh"], flat["x"], flat["R"]
        self.truth, self._episodes = np.array(arrays["truth"]), np.array(arrays["episodes"])
        self._measured = {name: float(value) for name, value in _below(flat, "measured.").items()}


def _below(flat: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in flat.items() if name.startswith(prefix)}


def _tensor(array: Array) -> Tensor:
    """A float32 copy: the simulator overwrites its arrays."""
    return torch.tensor(np.asarray(array), dtype=torch.float32)
