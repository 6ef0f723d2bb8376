"""Supervised training of the cell on recorded sequences: truncated backpropagation through time, Adam."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from randomization import stream
from tactile_kit.estimator.cell import Encode, EstimatorCell
from tactile_kit.estimator.errors import EstimatorError
from tactile_kit.estimator.recurrence import sequence_loss
from tactile_kit.estimator.sequences import Sequences

_MOMENTS = ("exp_avg", "exp_avg_sq", "step")


class EstimatorTrainer:
    """Adam on minibatches of sequences (learning rate, betas, weight decay, gradient norm: the website's).

    Args:
        cell: trained in place.
        encoding: the cell's shape encoding; bps: the distance encoding for the loss, over the same meshes.
        seed: of the shuffling; minibatches depend on it and on the iteration alone.

    Attributes:
        iteration: calls of :meth:`train` so far.
    """

    def __init__(self, cell: EstimatorCell, encoding: Encode, bps: Encode, seed: int = 0) -> None:
        config = cell.config
        self.cell, self.encoding, self.bps, self.seed, self.iteration = cell, encoding, bps, seed, 0
        self.optimizer = torch.optim.Adam(
            cell.parameters(),
            lr=config.learning_rate,
            betas=config.betas,
            weight_decay=config.weight_decay,
            fused=True,
        )

    def train(self, recent: list[Sequences], visits: int) -> dict[str, float]:
        """Gradient steps on ``visits`` sequences, shuffled through all of ``recent`` before any comes twice.

        Returns means over the minibatches: ``loss``, ``shape_error`` (m), ``angle_error`` (rad),
        ``position_error`` (m), ``sigma_v`` (m), ``sigma_R`` (rad), ``gradient_norm`` (before clipping).
        Raises EstimatorError if a loss or gradient is not finite; the weights are then as before that
        minibatch.
        """
        pool = Sequences.joined(recent)
        totals = torch.zeros(7)
        minibatches = 0
        if visits < 1:
            raise EstimatorError(f"visits = {visits}, allowed: 1 and more")
        for index in self._minibatches(len(pool), visits):
            totals += self._step(pool.columns(index))
            minibatches += 1
        self.iteration += 1
        names = (
            "loss",
            "shape_error",
            "angle_error",
            "position_error",
            "sigma_v",
            "sigma_R",
            "gradient_norm",
        )
        return dict(zip(names, (totals / minibatches).tolist(), strict=True))

    def _minibatches(self, count: int, visits: int) -> Iterator[Tensor]:
        rng = stream(self.seed, "estimator", "minibatches", self.iteration)
        passes = -(-visits // count)
        order = torch.cat([torch.from_numpy(rng.permutation(count)) for _ in range(passes)])[:visits]
        # never larger than the pool, or passes would melt into one step; equal parts: none weighs more
        size = min(self.cell.config.minibatch, count)
        return iter(order.tensor_split(-(-visits // size)))

    def _step(self, sequences: Sequences) -> Tensor:
        self.optimizer.zero_grad(set_to_none=True)
        losses = sequence_loss(self.cell, sequences, self.encoding, self.bps)
        losses.loss.backward()
        limit = self.cell.config.max_gradient_norm
        norm = torch.nn.utils.clip_grad_norm_(self.cell.parameters(), limit)
        if not torch.isfinite(losses.loss + norm):
            raise EstimatorError(
                f"estimator training, iteration {self.iteration}: loss {losses.loss.item()}, gradient norm "
                f"{norm.item()}, allowed: finite numbers"
            )
        self.optimizer.step()
        unit = self.cell.config.distance_unit
        parts = [losses.loss, unit * losses.shape, losses.angle, losses.position, unit * losses.sigma[0]]
        return torch.stack([*parts, losses.sigma[1], norm]).detach().float()

    def state_tensors(self) -> dict[str, Tensor]:
        """Weights, Adam's moments and the iteration as flat named tensors: ``cell.*``, ``adam.*``, ``iteration``."""
        flat = {f"cell.{name}": value.detach().clone() for name, value in self.cell.state_dict().items()}
        for name, parameter in self.cell.named_parameters():
            for moment, value in self.optimizer.state.get(parameter, {}).items():
                flat[f"adam.{moment}.{name}"] = torch.as_tensor(value).detach().clone()
        return flat | {"iteration": torch.tensor(self.iteration)}

    def load_state_tensors(self, flat: dict[str, Tensor]) -> None:
        """Inverse of :meth:`state_tensors`. Raises EstimatorError if names or shapes don't fit the cell."""
        weights = {
            name.removeprefix("cell."): value for name, value in flat.items() if name.startswith("cell.")
        }
        load_weights(self.cell, weights)
        self.optimizer.state.clear()
        for name, parameter in self.cell.named_parameters():
            found = {moment: flat[key] for moment in _MOMENTS if (key := f"adam.{moment}.{name}") in flat}
            if found:
                self.optimizer.state[parameter] = {moment: value.clone() for moment, value in found.items()}
        self.iteration = int(flat["iteration"])


def load_weights(cell: EstimatorCell, weights: dict[str, Tensor]) -> None:
    """``load_state_dict`` with an EstimatorError that names what doesn't fit."""
    try:
        cell.load_state_dict(weights)
    except RuntimeError as error:
        raise EstimatorError(f"weights don't fit the estimator {cell.config}: {error}") from None
