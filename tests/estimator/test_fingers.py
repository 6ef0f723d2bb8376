"""Fingers from measurements, the fits at a pose, and the cell that looks from the fingers."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from estimator_cases import CUBOID, TINY, boxes, make, motion

from tactile_kit.estimator import EstimatorError, sequence_loss
from tactile_kit.estimator.fingers import MEMORY, RADII, fingers
from tactile_kit.estimator.fits import fits
from tactile_kit.estimator.recurrence import unroll
from tactile_kit.estimator.so3 import exp
from tactile_kit.hand import kinematics
from tactile_kit.shape import PoseError
from tactile_kit.shape.function import basis_points, bps_vectors
from tactile_kit.shape.moving import surface_vectors

FINGER_CELL = TINY.model_copy(update={"cell": "fingers", "loss": "pose"})


def measurements(angles: np.ndarray, error: float = 0.0) -> torch.Tensor:
    """``(T, 1, 144)`` of joints that stand at ``angles (T, 12)`` during each step, with a constant control error."""
    rows = np.stack([angles, np.full_like(angles, error)], axis=1)
    return torch.from_numpy(np.tile(rows[:, None], (1, 6, 1, 1)).reshape(len(angles), 1, 144)).float()


def test_spheres_are_where_the_kinematics_put_them() -> None:
    angles = kinematics.MEAN_GRASP + 0.3 * np.random.default_rng(0).normal(size=(3, 12))
    seen = fingers(measurements(angles), torch.zeros(3, 1, dtype=torch.bool), torch.zeros(1, MEMORY))
    for q, points in zip(angles, seen.points[:, 0].reshape(3, 4, 4, 3).numpy(), strict=True):
        frames = kinematics.link_frames(q)
        middle = frames[:, 2, :3, 3] + frames[:, 2, :3, 0] * kinematics.MIDDLE.capsule.end
        np.testing.assert_allclose(points[:, 2], kinematics.tip_centres(q), atol=1e-6)
        np.testing.assert_allclose(points[:, 3], middle, atol=1e-6)
        inner = frames[:, 3, :3, 3] + frames[:, 3, :3, 1] * kinematics.DISTAL.capsule.start
        np.testing.assert_allclose(points[:, 0], inner, atol=1e-6)
    pads = seen.points[:, 0].reshape(3, 4, 4, 3)[:, :, 1]
    torch.testing.assert_close(seen.move[1:, 0], pads[1:] - pads[:-1])
    assert not seen.move[0].any()  # nothing before it


def test_the_series_spring_is_taken_out() -> None:
    """A control error of 0.1 rad stretches the spring by a fifth of it: the tip is where the joint is, behind it."""
    q = kinematics.MEAN_GRASP[None]
    seen = fingers(measurements(q, error=0.1), torch.ones(1, 1, dtype=torch.bool), torch.zeros(1, MEMORY))
    tips = seen.points[0, 0].reshape(4, 4, 3)[:, 2].numpy()
    np.testing.assert_allclose(tips, kinematics.tip_centres(q[0] - 0.02), atol=1e-6)
    aimed = kinematics.tip_centres(q[0] + 0.1)
    np.testing.assert_allclose(seen.push[0, 0].numpy(), aimed - tips, atol=1e-6)


def test_vectors_from_moving_points_are_those_from_the_same_points_at_rest() -> None:
    table = boxes(CUBOID)
    generator = torch.Generator().manual_seed(0)
    x = (0.01 * torch.randn(5, 3, generator=generator, dtype=torch.float64)).requires_grad_()
    turn = torch.randn(5, 3, generator=generator, dtype=torch.float64).requires_grad_()
    mesh = torch.zeros(5, dtype=torch.int64)
    points = torch.from_numpy(basis_points()[::4].copy()).repeat(5, 1, 1)
    weight = torch.randn(5, 16, 3, generator=generator, dtype=torch.float64)
    R = exp(turn)
    found = [surface_vectors(table, x, R, points, mesh), bps_vectors(table, x, R, mesh)[:, ::4]]
    torch.testing.assert_close(*found)
    slopes = [torch.autograd.grad((v * weight).sum(), [x, turn], retain_graph=True) for v in found]
    for one, other in zip(*slopes, strict=True):
        torch.testing.assert_close(one, other)
    with pytest.raises(PoseError, match=r"mesh\[2\]"):
        surface_vectors(table, x, R, points, torch.tensor([0, 0, 1, 0, 0]))


def test_fits_find_a_rigid_motion_and_the_way_to_the_fingers() -> None:
    """Four pads around a ball, pressed: what they carry along, and a ball that is 2 mm off."""
    centres = torch.tensor([[0.05, 0.0, 0.0], [-0.05, 0.0, 0.01], [0.0, 0.05, 0.0], [0.0, -0.05, -0.01]])
    points = centres.repeat_interleave(4, 0)[None] + torch.tensor([0.0, 0.0, 0.0, 0.0])[None, :, None].repeat(
        1, 4, 1
    )
    x = torch.zeros(1, 3)
    inwards = -torch.nn.functional.normalize(points, dim=-1)
    vectors = inwards * RADII[None, :, None]  # they touch
    push = 0.01 * inwards[:, ::4]
    w, v = torch.tensor([0.05, -0.08, 0.1]), torch.tensor([0.001, 0.002, -0.001])
    contacts = (points + vectors)[:, ::4]
    move = v + torch.linalg.cross(w.expand_as(contacts), contacts)
    found = fits(points, vectors, x, push, move)[0]
    torch.testing.assert_close(found[:3], v, atol=3e-4, rtol=0)
    torch.testing.assert_close(found[3:6], w, atol=6e-3, rtol=0)
    assert found[12:].min() > 0.8
    still = fits(points, vectors, x, push, torch.zeros_like(move))[0]
    assert still[:12].abs().max() < 1e-6
    gap = 0.002  # the surface is that far from the finger on the +x side and in the one on the other
    off = vectors.clone()
    off[:, :4] += gap * inwards[:, :4]
    off[:, 4:8] -= gap * inwards[:, 4:8]
    correction = fits(points, off, x, push, torch.zeros_like(move))[0, 6:9]
    assert 0.5 * gap < correction[0] < 1.5 * gap


def test_the_finger_cell_learns_and_goes_on_as_in_a_sequence() -> None:
    cell, shape, bps = make(FINGER_CELL)
    data = motion(np.random.default_rng(2), 6, 5, TINY.latent + MEMORY, restarts=0.2)
    losses = sequence_loss(cell, data, shape, bps)
    losses.loss.backward()
    assert all(value.grad is not None and value.grad.isfinite().all() for value in cell.parameters())
    run = unroll(cell, data, shape)
    state = data.state
    with torch.no_grad():
        for t in range(6):
            state = state.replaced(data.started[t], cell.initial(data.R_before[t]))
            state = cell(state, data.z[t], shape, data.mesh[t])
    for one, whole in zip(state, run.after, strict=True):
        torch.testing.assert_close(one, whole[-1].detach(), atol=2e-5, rtol=1e-4)
    assert cell.sigmas(state).shape == (5, 2)


def test_an_unknown_cell_is_refused() -> None:
    with pytest.raises(EstimatorError, match="'toes' unknown, allowed: paper, fingers"):
        make(TINY.model_copy(update={"cell": "toes"}))


@pytest.mark.parametrize("name", ["pos", "pos_rot", "none"])
def test_a_cell_that_looks_at_the_mesh_is_refused_to_agents_that_are_not_told_it(name: str) -> None:
    with pytest.raises(
        EstimatorError, match=f"'fingers' looks at the mesh, encoding '{name}' tells none; allowed: 'paper'"
    ):
        make(FINGER_CELL.model_copy(update={"encoding": name}))
