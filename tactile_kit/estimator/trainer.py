"""Supervised training of the cell on recorded sequences: truncated backpropagation through time, Adam, averaging."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor

from randomization import derive, stream
from tactile_kit.errors import EstimatorError
from tactile_kit.estimator import so3
from tactile_kit.estimator.averaging import Average
from tactile_kit.estimator.cell import EstimatorCell
from tactile_kit.estimator.losses import Encode, prepared, sequence_loss
from tactile_kit.estimator.sequences import Sequences
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.estimator.turn import turned

_MOMENTS = ("exp_avg", "exp_avg_sq", "step")
#: How far from the truth, at most, a lost estimate is put back: standard deviations in m and rad.
PUT_BACK = (0.012, 0.35)


class EstimatorTrainer:
    """Adam on minibatches of sequences (learning rate, betas, weight decay, gradient norm: the website's).

    What learns is a copy; ``cell`` gets the average of its weights.

    Args:
        cell: overwritten in place; whatever weights it has at the first training are learned on from.
        encoding: the cell's shape encoding; bps: the distance encoding for the loss, over the same meshes.
        seed: of the shuffling; minibatches depend on it and on the iteration alone.

    Attributes:
        iteration: calls of :meth:`train` so far.
        slowed: what the configured step size is multiplied by, from outside.
    """

    def __init__(self, cell: EstimatorCell, encoding: Any, bps: Encode, seed: int = 0) -> None:
        config = cell.config
        self.cell, self.encoding, self.bps, self.seed, self.iteration = cell, encoding, bps, seed, 0
        self.slowed = 1.0
        self.learning = copy.deepcopy(cell)
        self.average = Average(cell, self.learning, config.averaging)
        self.optimizer = torch.optim.Adam(
            self.learning.parameters(),
            lr=config.learning_rate,
            betas=config.betas,
            weight_decay=config.weight_decay,
            fused=True,
        )

    def train(self, recent: list[Sequences], visits: int) -> dict[str, float]:
        """Gradient steps on ``visits`` sequences, shuffled through all of ``recent`` before any comes twice.

        Returns means over the minibatches: ``loss``, ``shape_error`` (m), ``angle_error`` (rad),
        ``position_error`` (m), ``sigma_v`` (m), ``sigma_R`` (rad), ``gradient_norm`` (before clipping), ``lost``:
        the share of sequences whose estimate was put back near the truth, and ``rate``, Adam's step size by now.
        Raises EstimatorError if a loss or gradient is not finite; the weights are then as before that
        minibatch.
        """
        if visits < 1:
            raise EstimatorError(f"visits = {visits}, allowed: 1 and more")
        if not self.average.steps:  # a warm start may have filled the cell since
            self.learning.load_state_dict(self.cell.state_dict())
        pool = Sequences.joined(recent)
        pool, lost = self._put_back(prepared(self.cell, pool, self.bps))
        totals = torch.zeros(7)
        minibatches = 0
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
        return dict(zip(names, (totals / minibatches).tolist(), strict=True)) | {
            "lost": lost,
            "rate": self.rate,
        }

    @property
    def rate(self) -> float:
        """Adam's step size in the next gradient step."""
        return self.cell.config.learning_rate * self.slowed

    def _put_back(self, pool: Sequences) -> tuple[Sequences, float]:
        """Sequences that begin with a lost estimate begin near the truth instead; and their share.

        What is lost teaches nothing: far from the object, no step tells where it is.
        """
        config, state = self.cell.config, pool.state
        x, R = pool.x_before[0], pool.R_before[0]
        off = torch.linalg.vector_norm(state.x - x, dim=-1)
        lost = (so3.geodesic(state.R, R) > config.lost_angle) | (off > config.lost_distance)
        generator = torch.Generator().manual_seed(derive(self.seed, "estimator", "lost", self.iteration))
        far = torch.rand(len(x), 1, generator=generator) ** 1.5  # one share of both: most begin near
        place, turn = (far * size * torch.randn(len(x), 3, generator=generator) for size in PUT_BACK)
        with torch.no_grad():
            near = EstimatorState(x + place, turned(R, turn), self.learning.initial(R).latent)
        return pool.starting(state.replaced(lost, near)), float(lost.float().mean())

    def _minibatches(self, count: int, visits: int) -> Iterator[Tensor]:
        rng = stream(self.seed, "estimator", "minibatches", self.iteration)
        passes = -(-visits // count)
        order = torch.cat([torch.from_numpy(rng.permutation(count)) for _ in range(passes)])[:visits]
        # never larger than the pool, or passes would melt into one step; equal parts: none weighs more
        size = min(self.cell.config.minibatch, count)
        return iter(order.tensor_split(-(-visits // size)))

    def _step(self, sequences: Sequences) -> Tensor:
        self.optimizer.zero_grad(set_to_none=True)
        losses = sequence_loss(self.learning, sequences, self.encoding, self.bps)
        losses.loss.backward()
        limit = self.cell.config.max_gradient_norm
        norm = torch.nn.utils.clip_grad_norm_(self.learning.parameters(), limit)
        if not torch.isfinite(losses.loss + norm):
            raise EstimatorError(
                f"estimator training, iteration {self.iteration}: loss {losses.loss.item()}, gradient norm "
                f"{norm.item()}, allowed: finite numbers"
            )
        self.optimizer.param_groups[0]["lr"] = self.rate
        self.optimizer.step()
        self.average.update()
        unit = self.cell.config.distance_unit
        parts = [losses.loss, unit * losses.shape, losses.angle, losses.position, unit * losses.sigma[0]]
        return torch.stack([*parts, losses.sigma[1], norm]).detach().float()

    def state_tensors(self) -> dict[str, Tensor]:
        """Weights (average and raw), Adam's moments and counters as flat named tensors.

        ``cell.*``, ``learning.*``, ``adam.*``, ``averaged``, ``iteration``.
        """
        flat = {f"cell.{name}": value.detach().clone() for name, value in self.cell.state_dict().items()}
        for name, value in self.learning.state_dict().items():
            flat[f"learning.{name}"] = value.detach().clone()
        for name, parameter in self.learning.named_parameters():
            for moment, value in self.optimizer.state.get(parameter, {}).items():
                flat[f"adam.{moment}.{name}"] = torch.as_tensor(value).detach().clone()
        return flat | {
            "averaged": torch.tensor(self.average.steps),
            "iteration": torch.tensor(self.iteration),
        }

    def load_state_tensors(self, flat: dict[str, Tensor]) -> None:
        """Inverse of :meth:`state_tensors`. Raises EstimatorError if names or shapes don't fit the cell."""
        for part, cell in (("cell.", self.cell), ("learning.", self.learning)):
            load_weights(cell, {k.removeprefix(part): v for k, v in flat.items() if k.startswith(part)})
        self.optimizer.state.clear()
        for name, parameter in self.learning.named_parameters():
            found = {key: flat[at] for key in _MOMENTS if (at := f"adam.{key}.{name}") in flat}
            if any(value.shape != (parameter.shape if key != "step" else ()) for key, value in found.items()):
                raise EstimatorError(f"adam.{name}: its moments don't fit the estimator {self.cell.config}")
            if found:
                self.optimizer.state[parameter] = {key: value.clone() for key, value in found.items()}
        self.average.steps, self.iteration = int(flat["averaged"]), int(flat["iteration"])


def load_weights(cell: EstimatorCell, weights: dict[str, Tensor]) -> None:
    """``load_state_dict`` with an EstimatorError that names what doesn't fit."""
    try:
        cell.load_state_dict(weights)
    except RuntimeError as error:
        raise EstimatorError(f"weights don't fit the estimator {cell.config}: {error}") from None
