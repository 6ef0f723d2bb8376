"""The cell over a sequence, with the states and basis-point distances that the loss needs."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from tactile_kit.estimator import distances, loss
from tactile_kit.estimator.cell import Encode, EstimatorCell
from tactile_kit.estimator.repeated import Repeated
from tactile_kit.estimator.sequences import Sequences
from tactile_kit.estimator.state import EstimatorState


@dataclass(frozen=True)
class Unrolled:
    """States before and after each update, parts ``(T, E, ...)``; shape: the encoding before, or None if not kept."""

    before: EstimatorState
    after: EstimatorState
    shape: Tensor | None


def unroll(cell: EstimatorCell, sequences: Sequences, encoding: Encode) -> Unrolled:
    """Run the cell over all steps; an episode that starts inside begins at ``initial`` with no past."""
    steps, count, bfloat16 = sequences.steps, len(sequences), cell.config.bfloat16
    encoder = Repeated(cell.encoder, 1, steps * count, bfloat16)
    transition = Repeated(cell.transition, steps, count, bfloat16)
    # unbind: one gradient for all steps, where indexing would add up T full-sized ones
    features = cell.encode(sequences.z.flatten(0, 1), encoder).unflatten(0, (steps, count)).unbind(0)
    state, before, after, shapes = sequences.state.detach(), [], [], []

    def encode(x: Tensor, R: Tensor, mesh: Tensor) -> Tensor:
        shapes.append(encoding(x, R, mesh))
        return shapes[-1]

    restarts = sequences.started.any(dim=1).tolist()
    for t in range(sequences.steps):
        if restarts[t]:
            state = state.replaced(sequences.started[t], cell.initial(sequences.R_before[t]))
        before.append(state)
        state = cell.step(state, features[t], encode, sequences.mesh[t], transition)
        after.append(state)
    stack = [EstimatorState(*map(torch.stack, zip(*states, strict=True))) for states in (before, after)]
    return Unrolled(stack[0], stack[1], torch.stack(shapes) if shapes else None)


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


def sequence_loss(cell: EstimatorCell, sequences: Sequences, encoding: Encode, bps: Encode) -> Losses:
    """The paper's loss averaged over every state of the sequences: the initial ones and those after each update.

    Args:
        encoding: the cell's; bps: distances ``(B, N_b)`` m whatever the cell sees, because the loss is
            about shape even for an estimator without shape input (the mesh is known in training).
    """
    run = unroll(cell, sequences, encoding)
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
        if cell.shape_name == "bps":
            return _off(run.shape.flatten(0, 1), truth)
        if cell.shape_name == "vec_bps":
            return distances.vector_distance(run.shape.reshape(len(truth), -1, 3), truth)
    before = run.before
    return _off(bps(before.x.flatten(0, 1), before.R.flatten(0, 1), mesh.flatten()), truth)


def _off(estimate: Tensor, truth: Tensor) -> Tensor:
    return loss.shape_distance(truth, estimate)
