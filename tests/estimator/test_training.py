"""Loss and trainer: what is minimal where, what learning reaches, what saving keeps."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from estimator_cases import CUBE, CUBOID, TINY, boxes, make, motion

from tactile_kit.estimator import EstimatorConfig, EstimatorError, EstimatorTrainer, Sequences
from tactile_kit.estimator.loss import estimator_loss, negative_log_likelihood, shape_distance
from tactile_kit.estimator.losses import sequence_loss
from tactile_kit.estimator.recurrence import unroll
from tactile_kit.estimator.so3 import exp, geodesic
from tactile_kit.shape import encoding


def test_likelihood_is_that_of_the_normal_density() -> None:
    distance, sigma = torch.tensor([0.0, 0.3, 2.0]), torch.tensor([0.5, 0.02, 4.0])
    expected = -torch.distributions.Normal(0.0, sigma).log_prob(distance)
    torch.testing.assert_close(negative_log_likelihood(distance, sigma), expected)


def test_shape_distance_is_the_papers() -> None:
    truth, estimate = torch.tensor([[0.01, 0.0, 0.03]]), torch.tensor([[0.02, 0.005, 0.03]])
    torch.testing.assert_close(shape_distance(truth, estimate), torch.tensor([0.005]))


def test_loss_is_minimal_at_the_truth() -> None:
    bps = encoding("bps", boxes(CUBOID))
    mesh, sigmas = torch.zeros(1, dtype=torch.int64), torch.tensor([[0.3, 0.2]])
    x, R = torch.tensor([[0.004, -0.01, 0.002]]), exp(torch.tensor([[0.3, 0.2, -0.5]]))
    truth = bps(x, R, mesh)

    def value(dx: torch.Tensor, dr: torch.Tensor) -> float:
        estimate, R_hat = bps(x + dx, exp(dr) @ R, mesh), exp(dr) @ R
        return float(estimator_loss(shape_distance(truth, estimate) / 0.01, geodesic(R_hat, R), sigmas))

    zero = torch.zeros(1, 3)
    least = value(zero, zero)
    generator = torch.Generator().manual_seed(0)
    for size in (1e-3, 1e-2, 0.1):
        for _ in range(10):
            direction = torch.randn(1, 3, generator=generator)
            direction = direction / direction.norm()
            assert value(0.1 * size * direction, zero) > least
            assert value(zero, size * direction) > least


def test_shape_term_is_blind_to_symmetry_and_the_angle_term_is_not() -> None:
    bps = encoding("bps", boxes(CUBE))
    mesh, x, R = torch.zeros(1, dtype=torch.int64), torch.zeros(1, 3), torch.eye(3)[None]
    quarter = exp(torch.tensor([[0.0, 0.0, np.pi / 2]]))
    truth, turned = bps(x, R, mesh), bps(x, quarter, mesh)
    assert shape_distance(truth, turned) < 1e-6
    assert geodesic(quarter, R) == pytest.approx(np.pi / 2, abs=1e-5)


def test_best_sigma_is_the_size_of_the_error() -> None:
    """Gradient on sigma: wider if the error is larger than it, narrower if smaller."""
    for error in (0.05, 0.4):
        sigma = torch.tensor([0.2], requires_grad=True)
        (slope,) = torch.autograd.grad(negative_log_likelihood(torch.tensor([error]), sigma).sum(), sigma)
        assert (slope < 0) == (error > 0.2)


def test_learning_beats_the_start_pose_and_knows_its_uncertainty() -> None:
    """A cube and a cuboid turn, measurements tell of it: the trained cell must follow, also on unseen motion."""
    torch.set_num_threads(1)
    config = EstimatorConfig.preset(
        "small", learning_rate=2e-3, transition_hidden=(128, 128), encoder_hidden=(64,)
    )
    cell, shape, bps = make(config)
    trainer = EstimatorTrainer(cell, shape, bps, seed=1)
    rng = np.random.default_rng(0)
    test = motion(np.random.default_rng(1000), 24, 64, config.latent)
    still = geodesic(test.R, test.R_before[0]).mean().item()
    before = evaluate(trainer, test)
    for _ in range(60):
        data = motion(rng, 24, 64, config.latent, restarts=0.02)
        metrics = trainer.train([data], visits=64)
    after = evaluate(trainer, test)
    assert before["angle"] > 0.9 * still
    assert after["angle"] < 0.5 * still
    assert after["loss"] < before["loss"] - 1
    assert metrics["angle_error"] < 0.5 * still
    assert metrics["position_error"] < 0.02
    # later in the episode errors have grown, and so must the predicted sigma
    run = unroll(cell, test, shape)
    sigma = cell.sigmas_of(run.after.latent)[..., 1].detach().mean(dim=1)
    assert sigma[-1] > 1.5 * sigma[0]
    assert 0.3 < sigma[-1] / geodesic(run.after.R[-1], test.R[-1]).square().mean().sqrt() < 3


def evaluate(trainer: EstimatorTrainer, data: Sequences) -> dict[str, float]:
    with torch.no_grad():
        losses = sequence_loss(trainer.cell, data, trainer.encoding, trainer.bps)
    run = unroll(trainer.cell, data, trainer.encoding)
    return {"loss": losses.loss.item(), "angle": geodesic(run.after.R, data.R).mean().item()}


def trained(steps: int) -> tuple[EstimatorTrainer, list[Sequences]]:
    cell, shape, bps = make()
    trainer = EstimatorTrainer(cell, shape, bps, seed=3)
    data = [motion(np.random.default_rng(i), 6, 20, TINY.latent, restarts=0.1) for i in range(2)]
    for _ in range(steps):
        trainer.train(data, visits=40)
    return trainer, data


def test_saved_state_continues_exactly() -> None:
    straight, data = trained(4)
    half, _ = trained(2)
    flat = {name: value.clone() for name, value in half.state_tensors().items()}
    assert all(isinstance(value, torch.Tensor) for value in flat.values())
    cell, shape, bps = make(seed=77)
    other = EstimatorTrainer(cell, shape, bps, seed=3)
    other.load_state_tensors(flat)
    for _ in range(2):
        other.train(data, visits=40)
    for name, value in straight.state_tensors().items():
        assert torch.equal(value, other.state_tensors()[name]), name


def test_the_cell_is_the_average_of_what_learns() -> None:
    trainer, data = trained(0)
    seen = []
    update = trainer.average.update
    trainer.average.update = lambda: (
        update(),
        seen.append([p.clone() for p in trainer.learning.parameters()]),
    )
    for _ in range(12):
        trainer.train(data, visits=40)
    average = seen[0]
    for number, raw in enumerate(seen, 1):
        share = max(1 - TINY.averaging, 9 / (9 + number))
        average = [(1 - share) * a + share * b for a, b in zip(average, raw, strict=True)]
    for kept, wanted in zip(trainer.cell.parameters(), average, strict=True):
        torch.testing.assert_close(kept.data, wanted.data, rtol=1e-4, atol=1e-5)


def test_the_step_size_is_slowed_from_outside() -> None:
    cell, shape, bps = make()
    trainer = EstimatorTrainer(cell, shape, bps)
    data, rates = [motion(np.random.default_rng(0), 4, 8, TINY.latent)], []
    step = trainer.optimizer.step
    trainer.optimizer.step = lambda: (rates.append(trainer.optimizer.param_groups[0]["lr"]), step())  # type: ignore[method-assign]
    for trainer.slowed in (1.0, 0.25):
        told = trainer.train(data, visits=8)
    assert rates == pytest.approx([TINY.learning_rate, TINY.learning_rate / 4])
    assert told["rate"] == pytest.approx(rates[-1])


def test_training_goes_on_from_the_weights_that_the_cell_was_given() -> None:
    trainer, data = trained(6)
    cell, shape, bps = make(seed=5)
    other = EstimatorTrainer(cell, shape, bps, seed=3)
    cell.load_state_dict(trainer.cell.state_dict())  # a warm start
    other.train(data, visits=1)
    for one, given in zip(other.learning.parameters(), trainer.cell.parameters(), strict=True):
        assert (one - given).abs().max() < 3 * TINY.learning_rate


def test_lost_estimates_are_put_back_near_the_truth_and_others_left_alone() -> None:
    cell, shape, bps = make()
    trainer = EstimatorTrainer(cell, shape, bps)
    data = motion(np.random.default_rng(4), 3, 40, TINY.latent)
    turn = torch.zeros(40, 3)
    turn[:10, 0], turn[10:20, 1] = 1.3, 0.8  # rad: lost, not lost
    x = data.x_before[0].clone()
    x[20:30, 2] += 0.06
    latent = torch.ones(40, TINY.latent)
    state = type(data.state)(x, exp(turn) @ data.R_before[0], latent)
    pool, share = trainer._put_back(data.starting(state))
    assert share == pytest.approx(20 / 40)
    kept = [*range(10, 20), *range(30, 40)]
    for new, old in zip(pool.state.rows(kept), state.rows(kept), strict=True):
        assert torch.equal(new, old)
    back = [*range(10), *range(20, 30)]
    assert geodesic(pool.state.R, data.R_before[0])[back].max() < 1.2
    assert (pool.state.x - data.x_before[0]).norm(dim=1)[back].max() < 0.05
    assert geodesic(pool.state.R, data.R_before[0])[back].mean() > 0.02
    assert torch.equal(pool.state.latent[back], cell.latent0.detach().expand(20, -1))


def test_weights_of_another_size_are_refused() -> None:
    trainer, _ = trained(1)
    cell, shape, bps = make(TINY.model_copy(update={"latent": 7}))
    with pytest.raises(EstimatorError, match="latent0"):
        EstimatorTrainer(cell, shape, bps).load_state_tensors(trainer.state_tensors())


def test_gradients_are_scaled_to_the_limit() -> None:
    cell, shape, bps = make(TINY.model_copy(update={"max_gradient_norm": 1e-3}))
    trainer = EstimatorTrainer(cell, shape, bps)
    metrics = trainer.train([motion(np.random.default_rng(0), 4, 8, TINY.latent)], visits=8)
    norm = torch.sqrt(sum(p.grad.square().sum() for p in trainer.learning.parameters()))
    assert metrics["gradient_norm"] > 1e-3
    assert norm.item() == pytest.approx(1e-3, rel=1e-3)


def test_minibatches_visit_all_before_any_twice() -> None:
    trainer, _ = trained(0)
    batches = list(trainer._minibatches(20, 50))
    order = torch.cat(batches).tolist()
    assert len(order) == 50
    assert sorted(order[:20]) == sorted(order[20:40]) == list(range(20))
    assert max(map(len, batches)) <= TINY.minibatch
    # a minibatch larger than what there is would hold the same sequence twice
    few = [batch.tolist() for batch in trainer._minibatches(5, 15)]
    assert [sorted(batch) for batch in few] == [list(range(5))] * 3


def test_not_finite_data_stops_training_and_spares_the_weights() -> None:
    trainer, data = trained(1)
    before = trainer.state_tensors()
    data[0].z[2, 3, 4] = torch.inf
    with pytest.raises(ValueError):
        trainer.train(data[:1], visits=16)
    spoilt = [name for name, value in trainer.state_tensors().items() if not torch.isfinite(value).all()]
    assert not spoilt
    assert before.keys() == trainer.state_tensors().keys()


def test_sequences_check_shapes() -> None:
    data = motion(np.random.default_rng(0), 4, 3, TINY.latent)
    parts = data.tensors()
    parts["x"] = parts["x"][:, :2]
    with pytest.raises(EstimatorError, match=r"x has shape \(4, 2, 3\), allowed: \(4, 3, 3\)"):
        Sequences.from_tensors(parts)
