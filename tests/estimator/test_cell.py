"""The recurrent cell: sizes, gradients, restarts, orthonormality, switches."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from estimator_cases import TINY, boxes, make, motion
from pydantic import ValidationError

from tactile_kit.estimator import EstimatorConfig, EstimatorError, Sequences, cell_of
from tactile_kit.estimator.losses import sequence_loss
from tactile_kit.estimator.recurrence import unroll
from tactile_kit.shape import ENCODINGS


def test_paper_sizes() -> None:
    cell, *_ = make(EstimatorConfig())
    widths = [layer.in_features for layer in cell.transition if isinstance(layer, torch.nn.Linear)]
    assert widths == [265, 512, 512, 512, 512]
    assert cell.transition[-1].out_features == 38
    assert [layer.in_features for layer in cell.encoder if isinstance(layer, torch.nn.Linear)] == [144] + [
        512
    ] * 4
    assert cell.encoder[-1].out_features == 32
    assert [layer.in_features for layer in cell.sigma_net if isinstance(layer, torch.nn.Linear)] == [32] + [
        256
    ] * 4
    config = cell.config
    assert (config.learning_rate, config.betas, config.weight_decay) == (5e-4, (0.9, 0.99), 1e-5)
    assert (config.minibatch, config.max_gradient_norm) == (1024, 1.0)


def test_config_refuses_what_it_does_not_know() -> None:
    with pytest.raises(ValidationError, match="nearest valid name: 'latent'"):
        EstimatorConfig(latents=3)
    with pytest.raises(ValidationError, match="frozen"):
        EstimatorConfig().latent = 3
    with pytest.raises(EstimatorError, match="nearest valid name: 'small'"):
        EstimatorConfig.preset("smal")


@pytest.mark.parametrize("name", sorted(ENCODINGS))
def test_every_encoding_fits_into_the_recurrence(name: str) -> None:
    cell, shape, bps = make(TINY.model_copy(update={"encoding": name}))
    data = motion(np.random.default_rng(0), 4, 5, TINY.latent, restarts=0.3)
    losses = sequence_loss(cell, data, shape, bps)
    losses.loss.backward()
    missing = [
        key for key, value in cell.named_parameters() if value.grad is None or not value.grad.isfinite().all()
    ]
    assert not missing
    # a class does as well as an instance: weights are loaded before any mesh is known
    assert cell_of(cell.config, ENCODINGS[name]).state_dict().keys() == cell.state_dict().keys()


def test_initial_state_is_given_rotation_and_learned_rest() -> None:
    cell, *_ = make()
    with torch.no_grad():
        cell.x0.copy_(torch.tensor([0.1, 0.2, 0.3]))
    R0 = motion(np.random.default_rng(0), 1, 3, 6).R[0]
    state = cell.initial(R0)
    assert torch.equal(state.R, R0)
    assert torch.equal(state.x, (0.03 * cell.x0).repeat(3, 1))
    state.x.sum().backward()
    assert cell.x0.grad.abs().min() > 0


def test_wrong_measurements_are_refused() -> None:
    cell, shape, _ = make()
    state = cell.initial(torch.eye(3).repeat(2, 1, 1))
    with pytest.raises(EstimatorError, match=r"143.*144"):
        cell(state, torch.zeros(2, 143), shape, torch.zeros(2, dtype=torch.int64))


def test_rotation_stays_orthonormal() -> None:
    cell, shape, _ = make()
    with torch.no_grad():
        cell.transition[-1].weight.mul_(100)  # turns by far more than an object does
        state = cell.initial(torch.eye(3).repeat(8, 1, 1))
        generator = torch.Generator().manual_seed(0)
        moved = 0.0
        for _ in range(300):
            before = state.R
            state = cell(
                state, torch.randn(8, 144, generator=generator), shape, torch.zeros(8, dtype=torch.int64)
            )
            state = state._replace(x=state.x.clamp(-0.1, 0.1), latent=state.latent.clamp(-3, 3))
            moved += float((state.R - before).norm())
    assert moved > 100
    error = (state.R.transpose(1, 2) @ state.R - torch.eye(3)).abs().max()
    assert error < 1e-6
    assert torch.linalg.det(state.R).min() > 0.99


def test_no_estimate_runs_away() -> None:
    cell, shape, _ = make()
    with torch.no_grad():
        cell.transition[-1].weight.mul_(1e4)
        state = cell.initial(torch.eye(3).repeat(8, 1, 1))
        generator = torch.Generator().manual_seed(0)
        for _ in range(50):
            z = torch.randn(8, 144, generator=generator)
            state = cell(state, z, shape, torch.zeros(8, dtype=torch.int64))
    assert state.x.abs().max() == pytest.approx(0.12)
    assert state.latent.abs().max() == pytest.approx(30.0)


def test_sigmas_are_positive_and_bounded_below() -> None:
    cell, *_ = make()
    with torch.no_grad():
        cell.sigma_net[-1].weight.mul_(1000)
        sigmas = cell.sigmas_of(torch.randn(500, TINY.latent))
    assert sigmas.shape == (500, 2)
    assert sigmas.min() >= cell.config.sigma_floor
    assert sigmas.max() > 5


def test_gradient_flows_through_the_encoding_unless_stopped() -> None:
    gradients = {}
    for stop in (False, True):
        cell, shape, _ = make(TINY.model_copy(update={"stop_gradient": stop}))
        poses = []

        def watching(x, R, mesh, shape=shape, poses=poses):
            poses.append((x, R))
            return shape(x, R, mesh)

        run = unroll(cell, motion(np.random.default_rng(0), 3, 4, TINY.latent), watching)
        reached = [x.requires_grad and R.requires_grad for x, R in poses[1:]]
        assert reached == [not stop] * 2
        run.after.R[-1, :, :, 0].sum().backward()
        gradients[stop] = cell.x0.grad
        assert gradients[stop].abs().sum() > 0  # x̂ itself is an input too
    assert not torch.allclose(gradients[False], gradients[True], rtol=1e-3, atol=0)


@pytest.mark.parametrize("name", ["vec_bps", "bps", "none"])
def test_a_restart_equals_two_sequences(name: str) -> None:
    cell, shape, bps = make(TINY.model_copy(update={"encoding": name}))
    data = motion(np.random.default_rng(1), 9, 6, TINY.latent)
    start = 4
    started = data.started.clone()
    started[start, :] = True
    whole = unroll(cell, _with(data, started=started), shape)
    cut = [_steps(data, slice(0, start)), _steps(_with(data, started=started), slice(start, None))]
    parts = [unroll(cell, part, shape) for part in cut]
    for joined, *pieces in zip(whole.after, *(part.after for part in parts), strict=True):
        torch.testing.assert_close(joined, torch.cat(pieces))
    # the loss counts initial states too: start + 1 states in the first part, 5 + 1 in the second
    losses = [sequence_loss(cell, part, shape, bps).loss for part in cut]
    total = sequence_loss(cell, _with(data, started=started), shape, bps).loss
    torch.testing.assert_close(total, (5 * losses[0] + 6 * losses[1]) / 11)
    # and nothing of the first part's past leaks over the restart
    gradient = torch.autograd.grad(
        whole.after.R[start:, :, :, 0].sum() + whole.after.x[start:].sum(), cell.x0
    )[0]
    alone = torch.autograd.grad(parts[1].after.R[:, :, :, 0].sum() + parts[1].after.x.sum(), cell.x0)[0]
    torch.testing.assert_close(gradient, alone)


def test_a_sequence_continues_where_the_state_was_stored() -> None:
    cell, shape, _ = make()
    data = motion(np.random.default_rng(2), 8, 5, TINY.latent)
    whole = unroll(cell, data, shape)
    middle = type(data.state)(*(part[4] for part in whole.before))
    second = _with(_steps(data, slice(4, None)), state=middle)
    torch.testing.assert_close(unroll(cell, second, shape).after.R, whole.after.R[4:])
    # the stored state is data: no gradient reaches back through it
    (gradient,) = torch.autograd.grad(unroll(cell, second, shape).after.x.sum(), cell.x0, allow_unused=True)
    assert gradient is None


def test_a_stored_state_is_not_judged() -> None:
    """It came from older weights and can't be improved: its truth must not enter the loss, an initial state's must."""
    cell, shape, bps = make()
    data = motion(np.random.default_rng(4), 3, 4, TINY.latent)
    elsewhere = data.x_before.clone()
    elsewhere[0] += 0.02
    for started, differs in ((data.started, True), (torch.zeros_like(data.started), False)):
        losses = [
            sequence_loss(cell, _with(data, started=started, x_before=x), shape, bps).loss
            for x in (data.x_before, elsewhere)
        ]
        assert bool((losses[0] - losses[1]).abs() > 1e-4) == differs


@pytest.mark.parametrize("name", ["vec_bps", "bps", "pos", "none"])
def test_loss_gradient_against_finite_differences(name: str) -> None:
    """Whole cell and loss in float64, through the recurrence and the basis points, along random directions."""
    table = boxes((0.05, 0.07, 0.085), (0.06, 0.05, 0.08))
    cell, shape, bps = make(TINY.model_copy(update={"encoding": name}), table, dtype=torch.float64)
    data = _double(motion(np.random.default_rng(3), 6, 3, TINY.latent, restarts=0.2))
    parameters = [value for value in cell.parameters() if value.requires_grad]

    def value() -> torch.Tensor:
        return sequence_loss(cell, data, shape, bps).loss

    gradients = torch.autograd.grad(value(), parameters)
    generator = torch.Generator().manual_seed(0)
    agreed = 0
    for _ in range(8):
        direction = [torch.randn(p.shape, generator=generator, dtype=p.dtype) for p in parameters]
        norm = torch.sqrt(sum((d * d).sum() for d in direction))
        direction = [d / norm for d in direction]
        analytic = sum((g * d).sum() for g, d in zip(gradients, direction, strict=True))
        step = 1e-6
        with torch.no_grad():
            values = []
            for sign in (1, -2):
                for parameter, d in zip(parameters, direction, strict=True):
                    parameter.add_(sign * step * d)
                values.append(value())
            for parameter, d in zip(parameters, direction, strict=True):
                parameter.add_(step * d)
        numeric = (values[0] - values[1]) / (2 * step)
        agreed += bool(abs(numeric - analytic) < 1e-5 * max(1.0, abs(analytic)))
    # |v| and ReLU have kinks, and a direction may cross one; all but one must agree
    assert agreed >= 7


def _with(data: Sequences, **changes) -> Sequences:
    return Sequences(**{**{name: getattr(data, name) for name in data.__dataclass_fields__}, **changes})


def _steps(data: Sequences, index: slice) -> Sequences:
    parts = data.tensors()
    arrays = {name: value[index] for name, value in parts.items() if not name.startswith("state.")}
    return Sequences(**arrays, state=data.state)


def _double(data: Sequences) -> Sequences:
    parts = {
        name: value.double() if value.is_floating_point() else value for name, value in data.tensors().items()
    }
    return Sequences.from_tensors(parts)
