"""Fast parts beside their obvious twins: the repeated perceptron, and the distances of the loss."""

from __future__ import annotations

import pytest
import torch

from tactile_kit.estimator.cell import mlp
from tactile_kit.estimator.distances import angle, vector_distance
from tactile_kit.estimator.fingers import RADII, Fingers
from tactile_kit.estimator.fits import FIT_SCALE, fits
from tactile_kit.estimator.loss import shape_distance
from tactile_kit.estimator.repeated import Repeated
from tactile_kit.estimator.so3 import exp, geodesic, safe_norm, to_6d
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.estimator.step import FARTHEST, LARGEST_LATENT, LARGEST_TURN, LENGTH_SCALE, moved
from tactile_kit.estimator.touch import touch


def recurrence(apply, x: torch.Tensor, steps: int) -> torch.Tensor:
    """A small recurrence whose state feeds back: the sum of all its states' squares."""
    total = torch.zeros((), dtype=x.dtype)
    for _ in range(steps):
        x = torch.cat([torch.tanh(apply(x)) + x[:, :3], x[:, 3:]], dim=1)
        total = total + x.square().sum()
    return total


@pytest.mark.parametrize("bfloat16", [False, True])
def test_repeated_perceptron_has_the_plain_ones_gradients(bfloat16: bool) -> None:
    torch.manual_seed(0)
    net = mlp((7, 20, 16, 3))
    x = torch.randn(11, 7, requires_grad=True)
    inputs = [x, *net.parameters()]
    plain = recurrence(net, x, 5)
    wanted = torch.autograd.grad(plain, inputs)
    repeated = Repeated(net, 8, 11, bfloat16)  # three applications more than are used
    value = recurrence(repeated, x, 5)
    found = torch.autograd.grad(value, inputs)
    tolerance = 0.03 if bfloat16 else 1e-5
    assert value.item() == pytest.approx(plain.item(), rel=tolerance)
    for one, other in zip(found, wanted, strict=True):
        assert (one - other).norm() < tolerance * other.norm()
        assert one.dtype == torch.float32


def test_a_perceptron_is_repeated_no_more_often_than_announced() -> None:
    repeated = Repeated(mlp((4, 5, 2)), 2, 3)
    for _ in range(2):
        repeated(torch.zeros(3, 4))
    with pytest.raises(IndexError):
        repeated(torch.zeros(3, 4))


def test_distance_of_vectors_is_the_papers() -> None:
    generator = torch.Generator().manual_seed(1)
    vectors = 0.03 * torch.randn(40, 64, 3, generator=generator, dtype=torch.float64)
    vectors[:, :7] = 0.0  # inside the mesh
    vectors.requires_grad_()
    truth = 0.05 * torch.rand(40, 64, generator=generator, dtype=torch.float64)
    weight = torch.rand(40, generator=generator, dtype=torch.float64)
    one = vector_distance(vectors, truth)
    other = shape_distance(truth, safe_norm(vectors))
    torch.testing.assert_close(one, other)
    slopes = [torch.autograd.grad((d * weight).sum(), vectors)[0] for d in (one, other)]
    torch.testing.assert_close(*slopes)
    assert not slopes[0][:, :7].any()


def test_angle_is_the_geodesic_one() -> None:
    generator = torch.Generator().manual_seed(2)

    def draw() -> torch.Tensor:
        return torch.randn(60, 3, generator=generator, dtype=torch.float64)

    turn, start, R, weight = draw().requires_grad_(), exp(draw()), exp(draw()), draw()[:, 0]
    R[:5] = (exp(turn) @ start)[:5].detach()  # no angle at all
    found = []
    for distance in (angle, geodesic):
        theta = distance(exp(turn) @ start, R)
        found.append((theta, torch.autograd.grad((theta * weight).sum(), turn)[0]))
    torch.testing.assert_close(found[0][0], found[1][0], atol=1e-9, rtol=1e-9)
    torch.testing.assert_close(found[0][1][5:], found[1][1][5:])
    assert found[0][1].isfinite().all()


def slopes_of(outputs: tuple[torch.Tensor, ...], inputs: list[torch.Tensor]) -> tuple[torch.Tensor, ...]:
    """Gradients of a weighted sum of all outputs."""
    generator = torch.Generator().manual_seed(5)
    total = sum((part * torch.randn(part.shape, generator=generator)).sum() for part in outputs)
    return torch.autograd.grad(total, inputs, allow_unused=True)  # type: ignore[arg-type]


def touch_by_torch(
    state: EstimatorState, at: torch.Tensor, vectors: torch.Tensor, seen: Fingers
) -> torch.Tensor:
    """What ``touch`` compiles."""
    distance = (vectors.square().sum(-1) + 1e-10).sqrt()
    towards = (vectors / distance[..., None]).unflatten(1, (4, 4))[:, :, 1]
    lever = seen.points.unflatten(1, (4, 4))[:, :, 1] - at[:, None]
    clearance = ((distance - RADII) / 0.006).clamp(-3.0, 6.0)
    parts = [
        state.latent,
        seen.joints,
        state.x / LENGTH_SCALE,
        to_6d(state.R),
        vectors.flatten(1) / 0.02,
        lever.flatten(1) / 0.05,
        seen.push.flatten(1) / 0.015,
        seen.move.flatten(1) / 0.005,
        torch.linalg.cross(lever, seen.move).flatten(1) / 2e-4,
        (seen.push * towards).sum(-1) / 0.015,
        (seen.move * towards).sum(-1) / 0.005,
        clearance,
        fits(seen.points, vectors, at, seen.push, seen.move) * FIT_SCALE,
    ]
    return torch.cat(parts, dim=1)


@pytest.mark.parametrize("stopped", [False, True])
def test_touch_is_what_torch_makes_of_it(stopped: bool) -> None:
    generator = torch.Generator().manual_seed(2)

    def noise(size: float, *shape: int) -> torch.Tensor:
        return size * torch.randn(*shape, generator=generator)

    state = EstimatorState(noise(0.02, 9, 3), exp(noise(1.0, 9, 3)), noise(1.0, 9, 5))
    vectors = noise(0.01, 9, 16, 3)
    vectors[0, :6] = 0.0  # inside the mesh
    vectors[1] *= 20.0  # further than clearances are told
    seen = Fingers(
        noise(1.0, 9, 72),
        noise(0.04, 9, 16, 3),
        noise(0.01, 9, 4, 3),
        noise(0.005, 9, 4, 3),
        noise(1.0, 9, 1),
    )
    inputs = [part.requires_grad_() for part in state]
    if not stopped:
        inputs.append(vectors.requires_grad_())
    at = state.x.detach() if stopped else state.x
    found, wanted = (look(state, at, vectors, seen) for look in (touch, touch_by_torch))
    torch.testing.assert_close(found, wanted)
    for one, other in zip(slopes_of((found,), inputs), slopes_of((wanted,), inputs), strict=True):
        torch.testing.assert_close(one, other, atol=1e-3, rtol=1e-4)


def moved_by_torch(state: EstimatorState, residual: torch.Tensor) -> EstimatorState:
    """What ``moved`` compiles."""
    latent, move, turn = residual.split([state.latent.shape[1], 3, 3], dim=-1)
    return EstimatorState(
        (state.x + 0.01 * move).clamp(-FARTHEST, FARTHEST),
        exp((0.1 * turn).clamp(-LARGEST_TURN, LARGEST_TURN)) @ state.R,
        (state.latent + latent).clamp(-LARGEST_LATENT, LARGEST_LATENT),
    )


def test_a_step_is_what_torch_makes_of_it_also_at_its_bounds() -> None:
    generator = torch.Generator().manual_seed(3)
    residual = torch.randn(12, 11, generator=generator)
    residual[0, 2], residual[1, 5], residual[2, 8] = 99.0, -99.0, 99.0  # latent state, position, turn
    state = EstimatorState(
        0.02 * torch.randn(12, 3, generator=generator),
        exp(torch.randn(12, 3, generator=generator)),
        torch.randn(12, 5, generator=generator),
    )
    inputs = [part.requires_grad_() for part in (*state, residual)]
    found, wanted = moved(state, residual), moved_by_torch(state, residual)
    for one, other in zip(found, wanted, strict=True):
        torch.testing.assert_close(one, other)
    assert found.latent[0, 2] == LARGEST_LATENT
    assert found.x[1, 0] == -FARTHEST
    for one, other in zip(slopes_of(found, inputs), slopes_of(wanted, inputs), strict=True):
        torch.testing.assert_close(one, other)
