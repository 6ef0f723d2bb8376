"""Losses over sequences: the paper's likelihood, and plain distances of the pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tactile_kit.estimator import distances, loss
from tactile_kit.estimator.cell import EstimatorCell
from tactile_kit.estimator.recurrence import Unrolled, unroll
from tactile_kit.estimator.sequences import Sequences

Encode = Callable[[Tensor, Tensor, Tensor], Tensor]

# The pose loss: rad and m below which an error counts by its square, what a metre costs in rad, and what sigma's
# likelihood counts beside it.
SOFT_ANGLE, SOFT_PLACE, METRE, SIGMA_SHARE = 0.05, 0.001, 20.0, 0.1


@dataclass(frozen=True)
class Losses:
    """Mean loss (with its graph) and means over the updated states.

    shape: d_v in the config's unit; angle: rad; position: m; sigma: ``(2,)``, the unit and rad.
    """

    loss: Tensor
    shape: Tensor
    angle: Tensor
    position: Tensor
    sigma: Tensor


def sequence_loss(cell: EstimatorCell, sequences: Sequences, encoding: Any, bps: Encode) -> Losses:
    """The loss that the cell's settings name; arguments as of :func:`likelihood`."""
    return LOSSES[cell.config.loss].of(cell, sequences, unroll(cell, sequences, encoding), bps)


def prepared(cell: EstimatorCell, sequences: Sequences, bps: Encode) -> Sequences:
    """The sequences with what every pass of the cell's loss would compute anew."""
    if not LOSSES[cell.config.loss].needs_distances:
        return sequences
    return sequences.with_distances(true_distances(sequences, bps))


def pose(cell: EstimatorCell, sequences: Sequences, run: Unrolled, bps: Encode) -> Losses:
    """Angle and distance to the true pose after every step; sigmas learn beside it how large these are (own).

    sigma_v and ``shape`` then speak of the distance of the positions, in the same unit.
    """
    counted = sequences.valid.flatten()
    angle = distances.angle(run.after.R.flatten(0, 1), sequences.R.flatten(0, 1))[counted]
    square = (run.after.x - sequences.x).square().sum(-1).flatten()[counted]
    value = (angle.square() + SOFT_ANGLE**2).sqrt() + METRE * (square + SOFT_PLACE**2).sqrt()
    sigmas = cell.sigmas_of(run.after.latent.flatten(0, 1)[counted])
    position = square.detach().sqrt()
    off, turned = position / cell.config.distance_unit, angle.detach()
    value = value + SIGMA_SHARE * loss.estimator_loss(off, turned, sigmas)
    return Losses(value.mean(), off.mean(), turned.mean(), position.mean(), sigmas.detach().mean(0))


def likelihood(cell: EstimatorCell, sequences: Sequences, run: Unrolled, bps: Encode) -> Losses:
    """The paper's loss averaged over every state of the sequences: the initial ones and those after each update.

    Args:
        run: the cell over the sequences; bps: distances ``(B, N_b)`` m whatever the cell sees, because the loss is
            about shape even for an estimator without shape input (the mesh is known in training).
    """
    started, mesh = sequences.started, sequences.mesh
    # A state after step t is the state before step t + 1, and its encoding has been computed there: only
    # where an episode or the sequence ends is another needed. The stored first state is data, not output: it
    # has no loss.
    counted = started.clone()
    counted[1:] = True
    ends = torch.ones_like(started)
    ends[:-1] = started[1:]
    ends &= sequences.valid
    with torch.no_grad():
        truth = true_distances(sequences, bps)
        last_truth = bps(sequences.x[ends], sequences.R[ends], mesh[ends])
    last = _off(bps(run.after.x[ends], run.after.R[ends], mesh[ends]), last_truth)
    distance = torch.cat([_distances(cell, run, truth, bps, mesh), last]) / cell.config.distance_unit
    angle = torch.cat(
        [
            distances.angle(run.before.R.flatten(0, 1), sequences.R_before.flatten(0, 1)),
            distances.angle(run.after.R[ends], sequences.R[ends]),
        ]
    )
    sigmas = cell.sigmas_of(torch.cat([run.before.latent.flatten(0, 1), run.after.latent[ends]]))
    value = loss.estimator_loss(distance, angle, sigmas)
    final = torch.ones(len(last))
    weight = torch.cat([counted.flatten().float(), final])
    # reported over states with an update behind them: at an episode's start the angle is zero by construction
    updated = torch.cat([(counted & ~started).flatten().float(), final])
    updated = (updated / updated.sum())[:, None]
    measured = torch.cat([distance[:, None], angle[:, None], sigmas], 1).detach()
    shape, turned, *sigma = (updated * measured).sum(0)
    position = torch.linalg.vector_norm(run.after.x - sequences.x, dim=-1)[sequences.valid]
    return Losses(
        (value * weight).sum() / weight.sum(), shape, turned, position.detach().mean(), torch.stack(sigma)
    )


def true_distances(sequences: Sequences, bps: Encode) -> Tensor:
    """Basis-point distances ``(T E, N_b)`` m at the true pose before every step; those stored, where they are."""
    if sequences.distances is not None:
        return sequences.distances.flatten(0, 1)
    with torch.no_grad():
        return bps(
            sequences.x_before.flatten(0, 1), sequences.R_before.flatten(0, 1), sequences.mesh.flatten()
        )


def _distances(cell: EstimatorCell, run: Unrolled, truth: Tensor, bps: Encode, mesh: Tensor) -> Tensor:
    """d_v ``(T E,)`` m at the estimates before each step, from the encoding where it contains them with a gradient."""
    if run.shape is not None and not cell.config.stop_gradient:
        if cell.shape.per_basis_point == 1:
            return _off(run.shape.flatten(0, 1), truth)
        if cell.shape.per_basis_point == 3:
            return distances.vector_distance(run.shape.reshape(len(truth), -1, 3), truth)
    before = run.before
    return _off(bps(before.x.flatten(0, 1), before.R.flatten(0, 1), mesh.flatten()), truth)


def _off(estimate: Tensor, truth: Tensor) -> Tensor:
    return loss.shape_distance(truth, estimate)


@dataclass(frozen=True)
class Loss:
    """A loss over sequences, and whether it compares basis-point distances."""

    of: Callable[[EstimatorCell, Sequences, Unrolled, Encode], Losses]
    needs_distances: bool


LOSSES = {"likelihood": Loss(likelihood, True), "pose": Loss(pose, False)}
