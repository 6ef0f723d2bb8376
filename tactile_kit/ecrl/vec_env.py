"""The batched environment of tactile agents: the policy is told what the estimator believes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray

from tactile_kit.ecrl.config import ECRLConfig
from tactile_kit.ecrl.coupling import Coupling
from tactile_kit.ecrl.privileged import TERMS, Truth
from tactile_kit.ecrl.watch import Watch
from tactile_kit.errors import EstimatorError
from tactile_kit.estimator.cell import EstimatorCell
from tactile_kit.estimator.cells import new_cell
from tactile_kit.estimator.config import EstimatorConfig
from tactile_kit.estimator.trainer import EstimatorTrainer
from tactile_kit.rotations import geodesic
from tactile_kit.shape import BPS, encoding
from tactile_kit.simulation.episode import Status
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.goals import EpisodeSpec
from tactile_kit.task.observation import Belief, Layout
from tactile_kit.task.variants import Variants
from tactile_kit.task.vec_env import ReorientVecEnv


class TactileVecEnv(ReorientVecEnv):
    """Environments whose observations hold the estimated object pose and its predicted uncertainties.

    In training it also records what the estimator sees and trains it every ``ecrl.rollout`` steps, inside
    ``step_wait``. Rewards and results are those of the true object all the same.

    Args:
        estimator: a trained or fresh cell, the settings of a new cell (weights from ``seed``), or anything with a
            cell's ``initial``, call and ``sigmas`` (``KalmanFilter``), which does not learn.
        ecrl: the coupling's settings.
        training: whether the estimator learns and truth may stand in for it; by default where no episodes are given.
        others: as for :class:`ReorientVecEnv`.

    Attributes:
        estimator: the cell or filter in use.
        coupling: states, recording and training.

    Raises:
        EstimatorError: the cell was made for another shape encoding.
    """

    sigma = True
    private: frozenset[str] = frozenset()  # terms of the observation that are for the critic alone

    def __init__(
        self,
        config: TaskConfig,
        *,
        num_envs: int,
        num_workers: int = 1,
        seed: int = 0,
        episodes: Iterable[EpisodeSpec] | None = None,
        variants: Variants | None = None,
        estimator: Any = None,
        ecrl: ECRLConfig | None = None,
        training: bool | None = None,
        workers: str = "processes",
    ) -> None:
        super().__init__(
            config,
            num_envs=num_envs,
            num_workers=num_workers,
            seed=seed,
            episodes=episodes,
            variants=variants,
            workers=workers,
        )
        try:
            self.coupling = self._couple(estimator or EstimatorConfig(), ecrl or ECRLConfig(), seed)
        except BaseException:
            self.close()  # the workers are running already
            raise
        self.estimator, self.watch, self._estimate = self.coupling.estimator, Watch(), self.coupling.state
        self.training = episodes is None if training is None else training
        self._truth: Truth | None = None
        if self.training and ecrl is not None and ecrl.critic_sees_truth:
            self._truth, self.private = Truth(self), frozenset(TERMS)
            self.layout = Layout({**self.layout.sizes, **TERMS})
            self.observation_space = spaces.Box(-np.inf, np.inf, (self.layout.size,), np.float32)

    def _couple(self, estimator: Any, ecrl: ECRLConfig, seed: int) -> Coupling:
        if not isinstance(estimator, (EstimatorCell, EstimatorConfig)):
            return Coupling(estimator, self.encoding, None, ecrl, self.num_envs, seed)
        settings = estimator if isinstance(estimator, EstimatorConfig) else estimator.config
        name = settings.encoding or self.config.encoding
        shape = self.encoding if name == self.config.encoding else encoding(name, self.meshes)
        cell = estimator if isinstance(estimator, EstimatorCell) else new_cell(settings, shape, seed)
        if cell.shape.name != name:
            raise EstimatorError(
                f"the estimator reads encoding {cell.shape.name!r}, the task and settings say {name!r}"
            )
        trainer = EstimatorTrainer(cell, shape, BPS(self.meshes), seed)
        return Coupling(cell, shape, trainer, ecrl, self.num_envs, seed)

    @property
    def training(self) -> bool:
        """Whether steps are recorded and the estimator is trained. Off, estimates always stand: rho is 0."""
        return self.coupling.training

    @training.setter
    def training(self, value: bool) -> None:
        self.coupling.training = bool(value) and self.coupling.trainer is not None

    @property
    def estimated(self) -> Belief:
        """The estimates after the last step, terminal where an episode ended, whatever the policy is told."""
        with torch.no_grad():
            sigma = self.estimator.sigmas(self._estimate).numpy()
        return Belief(self._estimate.x.numpy(), self._estimate.R.numpy(), sigma)

    def _start_belief(self, mask: NDArray[np.bool_]) -> Belief:
        self.coupling.start(mask, self.state.x, self.state.R, self.state.R0)
        if self._truth is not None:
            self._truth.begin(mask)
        return Belief(*self.coupling.pose())

    def _observe(self) -> NDArray[np.float32]:
        seen = super()._observe()
        return seen if self._truth is None else np.concatenate([seen, self._truth()], axis=1)

    def _observe_again(
        self, observation: NDArray[np.float32], rows: NDArray[np.int64]
    ) -> NDArray[np.float32]:
        if self._truth is None:
            return super()._observe_again(observation, rows)
        size, again = self.core.layout.size, observation.copy()
        again[:, :size] = super()._observe_again(observation[:, :size], rows)
        again[rows, size:] = self._truth(rows)
        return again

    def _update_belief(self) -> Belief:
        state, valid = self.state, self.simulation.views["status"] != Status.FAULT
        before = self.coupling.true_pose[1]
        if self._truth is not None:
            self._truth.step(*self.coupling.true_pose)
        self.coupling.update(state.z, state.given, state.x, state.R, valid)
        self._estimate = self.coupling.state
        if self.training:
            self.watch.step(self.coupling.state.R.numpy(), state.R, before, self.coupling.truth)
        return Belief(*self.coupling.pose())

    def _finish(
        self, i: int, status: Status, ended: dict[str, Any], observation: NDArray[Any]
    ) -> dict[str, Any]:
        info = super()._finish(i, status, ended, observation)
        if self.training and not self.coupling.truth[i]:
            R_hat, state = self.coupling.state.R[i].numpy(), self.state
            believed, off = geodesic(R_hat, state.goal[i]), geodesic(R_hat, state.R[i])
            dropped = info["drop"] or status == Status.FAULT
            self.watch.end(info["success"], dropped, info["theta"], float(believed), float(off))
        return info

    @property
    def rho(self) -> float:
        """Probability that an episode starting now shows the policy the truth."""
        return self.coupling.rho

    def slow(self, factor: float) -> None:
        """From now on the estimator learns by ``factor`` times its configured step size."""
        if self.coupling.trainer is not None:
            self.coupling.trainer.slowed = factor

    def metrics(self) -> dict[str, float]:
        """rho, what the estimator's last training measured (``estimator/...``; m, rad), and ``Watch``'s."""
        return self.coupling.metrics() | self.watch.take()

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Weights, optimiser, recordings, states and counters as named arrays; the simulation is not in it."""
        return {**super().get_state(), **self.coupling.get_state()}

    def set_state(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Inverse of :meth:`get_state`; a ``reset`` afterwards starts new episodes and keeps all that was learned."""
        super().set_state(arrays)
        self.coupling.set_state({name: array for name, array in arrays.items() if name != "next_episode"})
