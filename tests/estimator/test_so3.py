"""Rotations in torch against the NumPy and SciPy ones, and their gradients where formulas break."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_kit import rotations
from tactile_kit.estimator import so3, turn
from tactile_kit.estimator.turn import turned

ANGLES = [0.0, 1e-12, 1e-8, 1e-4, 9.99e-3, 0.0101, 1.0, 3.0, np.pi - 1e-4, np.pi - 1e-8, np.pi]
AXES = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, -0.8), (0.36, 0.48, 0.8)]
both = pytest.mark.parametrize("dtype", [torch.float32, torch.float64])


def vectors(dtype: torch.dtype) -> torch.Tensor:
    return torch.tensor([[angle * part for part in axis] for angle in ANGLES for axis in AXES], dtype=dtype)


@both
def test_exp_and_geodesic_agree_with_numpy(dtype: torch.dtype) -> None:
    v = vectors(dtype)
    R = so3.exp(v)
    tolerance = 1e-6 if dtype == torch.float32 else 1e-14
    np.testing.assert_allclose(R, rotations.exp(v.double().numpy()), atol=tolerance)
    eye = torch.eye(3, dtype=dtype)
    np.testing.assert_allclose(so3.geodesic(R, eye), v.double().norm(dim=-1), atol=2 * tolerance)
    np.testing.assert_allclose(so3.to_6d(R), rotations.to_6d(R.numpy()))


@both
def test_log_inverts_exp(dtype: torch.dtype) -> None:
    v = vectors(dtype)
    back = so3.log(so3.exp(v))
    # at pi the axis may come back reversed, so rotations are compared
    tolerance = 3e-6 if dtype == torch.float32 else 1e-14
    np.testing.assert_allclose(so3.exp(back), so3.exp(v), atol=tolerance)
    assert back.norm(dim=-1).max() <= np.pi + 1e-6
    small = v.norm(dim=-1) < 3.1
    np.testing.assert_allclose(back[small], v[small], atol=tolerance)


@both
def test_gradients_are_finite_everywhere(dtype: torch.dtype) -> None:
    v = vectors(dtype).requires_grad_()
    R = so3.exp(v)
    eye = torch.eye(3, dtype=dtype)
    for value in (R.sum(), so3.geodesic(R, eye).sum(), so3.log(R).sum(), so3.geodesic(R, R.detach()).sum()):
        (gradient,) = torch.autograd.grad(value, v, retain_graph=True)
        assert torch.isfinite(gradient).all()
        assert gradient.abs().max() < 10


def test_geodesic_has_the_unit_axis_as_gradient() -> None:
    axes = torch.tensor(AXES, dtype=torch.float64)
    for angle in (1e-6, 0.1, 1.5, np.pi - 1e-6):
        R = so3.exp(angle * axes)
        step = torch.zeros_like(axes, requires_grad=True)
        value = so3.geodesic(so3.exp(step) @ R, torch.eye(3, dtype=torch.float64))
        (gradient,) = torch.autograd.grad(value.sum(), step)
        np.testing.assert_allclose(gradient, axes, atol=1e-9)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(1e-6, 3.1))
def test_compiled_turn_is_exp_times_rotation(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    R = torch.from_numpy(rotations.random_rotations(rng, 4)).requires_grad_()
    r = rng.standard_normal((4, 3))
    r = torch.from_numpy(size * r / np.linalg.norm(r, axis=1, keepdims=True)).requires_grad_()
    weights = torch.from_numpy(rng.standard_normal((4, 3, 3)))
    fast, slow = turned(R, r), so3.exp(r) @ R
    np.testing.assert_allclose(fast, slow.detach(), atol=1e-14)
    ours = np.empty((4, 3, 3)), np.empty((4, 3))
    turn.backward(r.detach().numpy(), fast.numpy(), weights.numpy(), *ours)
    for found, twin in zip(ours, torch.autograd.grad((weights * slow).sum(), (R, r)), strict=True):
        np.testing.assert_allclose(found, twin, atol=1e-12)


def test_turn_at_zero_and_strided_inputs() -> None:
    R = torch.eye(3).repeat(2, 1, 1).transpose(1, 2)
    r, back = torch.zeros(2, 6)[:, ::2], (np.empty((2, 3, 3), np.float32), np.empty((2, 3), np.float32))
    out = turned(R, r)
    assert torch.equal(out, R)
    turn.backward(r.contiguous().numpy(), out.numpy(), np.ones((2, 3, 3), np.float32), *back)
    assert np.isfinite(back[0]).all() and np.isfinite(back[1]).all()
