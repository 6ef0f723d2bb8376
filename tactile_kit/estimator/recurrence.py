"""The cell over a sequence, with the states and basis-point distances that the loss needs."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from tactile_kit.estimator import loss
from tactile_kit.estimator.cell import Encode, EstimatorCell
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
    # unbind: one gradient for all steps, where indexing would add up T full-sized ones
    features = cell.encode(sequences.z).unbind(0)
    state, before, after, shapes = sequences.state.detach(), [], [], []

    def encode(x: Tensor, R: Tensor, mesh: Tensor) -> Tensor:
        shapes.append(encoding(x, R, mesh))
        return shapes[-1]

    restarts = sequences.started.any(dim=1).tolist()
    for t in range(sequences.steps):
        if restarts[t]:
            state = state.replaced(sequences.started[t], cell.initial(sequences.R_before[t]))
        before.append(state)
        state = cell.step(state, features[t], encode, sequences.mesh[t])
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
    started = sequences.started
    # A state after step t is the state before step t + 1, and its encoding has been computed there: only
    # where an episode or the sequence ends is another needed. The stored first state is data, not output: it
    # has no loss.
    counted = started.clone()
    counted[1:] = True
    ends = torch.ones_like(started)
    ends[:-1] = started[1:]
    ends &= sequences.valid
    unit, mesh = cell.config.distance_unit, sequences.mesh
    with torch.no_grad():
        truth = bps(sequences.x_before[counted], sequences.R_before[counted], mesh[counted])
        last_truth = bps(sequences.x[ends], sequences.R[ends], mesh[ends])
    estimate = _distances(cell, run, counted, bps, mesh)
    last = bps(run.after.x[ends], run.after.R[ends], mesh[ends])
    latent = torch.cat([run.before.latent[counted], run.after.latent[ends]])
    R_hat = torch.cat([run.before.R[counted], run.after.R[ends]])
    R = torch.cat([sequences.R_before[counted], sequences.R[ends]])
    sigmas = cell.sigmas_of(latent)
    value, distance, angle = loss.estimator_loss(
        torch.cat([truth, last_truth]), torch.cat([estimate, last]), R, R_hat, sigmas, unit
    )
    # reported over states with an update behind them: at an episode's start the angle is zero by construction
    updated = torch.cat([~started[counted], torch.ones(len(last), dtype=torch.bool)])
    position = torch.linalg.vector_norm(run.after.x - sequences.x, dim=-1)[sequences.valid]
    return Losses(
        value.mean(),
        distance.detach()[updated].mean(),
        angle.detach()[updated].mean(),
        position.detach().mean(),
        sigmas.detach()[updated].mean(0),
    )


def _distances(cell: EstimatorCell, run: Unrolled, counted: Tensor, bps: Encode, mesh: Tensor) -> Tensor:
    """Distances at the estimates before each step, from the encoding where it contains them with their gradient."""
    if run.shape is not None and not cell.config.stop_gradient:
        if cell.shape_name == "bps":
            return run.shape[counted]
        if cell.shape_name == "vec_bps":
            return loss.magnitudes(run.shape[counted])
    return bps(run.before.x[counted], run.before.R[counted], mesh[counted])
