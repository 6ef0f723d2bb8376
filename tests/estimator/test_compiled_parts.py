"""Fast parts beside their obvious twins: the repeated perceptron, and the distances of the loss."""

from __future__ import annotations

import pytest
import torch

from tactile_kit.estimator.cell import mlp
from tactile_kit.estimator.distances import angle, vector_distance
from tactile_kit.estimator.loss import shape_distance
from tactile_kit.estimator.repeated import Repeated
from tactile_kit.estimator.so3 import exp, geodesic, safe_norm


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
