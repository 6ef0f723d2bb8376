"""The coupling on a toy world: who is told what, what is recorded, what is learned, what is resumed."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from estimator_cases import CUBE, CUBOID, TINY, boxes

from tactile_kit import rotations
from tactile_kit.ecrl import Coupling, ECRLConfig, Schedule
from tactile_kit.estimator import EstimatorConfig, EstimatorError, EstimatorTrainer, KalmanFilter, new_cell
from tactile_kit.estimator.losses import sequence_loss
from tactile_kit.estimator.recurrence import unroll
from tactile_kit.shape import encoding

E = 6
QUICK = ECRLConfig(rollout=5, reuse=2, kept=2, rho_start=0.5, rho_step=0.1)

# trains, but by nothing that float32 could show: recordings can be replayed with the weights they were made with
RIGID = TINY.model_copy(update={"learning_rate": 1e-30, "weight_decay": 0.0})


class World:
    """Objects that turn at random; the measurements mix the twist of the step. Episodes end after 7 steps or so."""

    def __init__(self, seed: int = 0, envs: int = E) -> None:
        self.rng, self.envs = np.random.default_rng(seed), envs
        self.mixing = np.random.default_rng(99).standard_normal((6, 144)) * 0.3
        self.given = self.rng.integers(0, 2, envs)
        self.x, self.R = np.zeros((envs, 3)), rotations.random_rotations(self.rng, envs)
        self.z = np.zeros((envs, 144))

    def begin(self, mask: np.ndarray) -> None:
        self.x[mask] = 0.005 * self.rng.standard_normal((mask.sum(), 3))
        self.R[mask] = rotations.random_rotations(self.rng, mask.sum())
        self.given[mask] = self.rng.integers(0, 2, mask.sum())

    def step(self) -> np.ndarray:
        twist = self.rng.standard_normal((self.envs, 6))
        self.R, self.x = rotations.exp(0.08 * twist[:, :3]) @ self.R, self.x + 0.002 * twist[:, 3:]
        self.z = 0.1 * twist @ self.mixing
        return self.rng.random(self.envs) < 0.15


def make(ecrl: ECRLConfig = QUICK, config: EstimatorConfig = TINY, envs: int = E, seed: int = 3) -> Coupling:
    table = boxes(CUBE, CUBOID)
    shape = encoding("vec_bps", table)
    cell = new_cell(config, shape, seed)
    return Coupling(
        cell, shape, EstimatorTrainer(cell, shape, encoding("bps", table), seed), ecrl, envs, seed
    )


def play(coupling: Coupling, world: World, steps: int, begin: bool = True) -> list[tuple[np.ndarray, ...]]:
    """Drives the coupling as the environment does; what the policy was told after each step."""
    told = []
    if begin:
        world.begin(np.ones(world.envs, bool))
        coupling.start(np.ones(world.envs, bool), world.x, world.R, world.R)
    for _ in range(steps):
        done = world.step()
        coupling.update(world.z, world.given, world.x, world.R)
        told.append(coupling.pose())
        if done.any():
            world.begin(done)
            coupling.start(done, world.x, world.R, world.R)
    return told


def test_schedule_falls_to_zero() -> None:
    schedule = Schedule(1.0, 5e-4)
    assert schedule.at(0) == 1.0
    assert schedule.at(1000) == pytest.approx(0.5)
    assert schedule.at(2000) == pytest.approx(0.0, abs=1e-12)
    assert schedule.at(5000) == 0.0


@pytest.mark.parametrize("rho", [0.0, 1.0])
def test_rho_decides_what_the_policy_is_told(rho: float) -> None:
    coupling, world = make(ECRLConfig(rollout=100, rho_start=rho)), World()
    play(coupling, world, 20)
    x, R, sigma = coupling.pose()
    truth = world.x.astype(np.float32), world.R.astype(np.float32)
    estimate = coupling.state.x.numpy(), coupling.state.R.numpy()
    for told, wanted, other in zip((x, R), *((truth, estimate) if rho else (estimate, truth)), strict=True):
        np.testing.assert_array_equal(told, wanted)
        assert np.abs(told - other).max() > 1e-3
    np.testing.assert_allclose(sigma, coupling.estimator.sigmas(coupling.state).detach())


def test_truth_is_drawn_per_episode_and_stays_for_it() -> None:
    coupling, world = make(ECRLConfig(rollout=10**6, rho_start=0.3), envs=50), World(envs=50)
    shares = []
    world.begin(np.ones(50, bool))
    coupling.start(np.ones(50, bool), world.x, world.R, world.R)
    for _ in range(40):
        before = coupling.truth.copy()
        done = world.step()
        coupling.update(world.z, world.given, world.x, world.R)
        np.testing.assert_array_equal(coupling.truth, before)
        coupling.start(done, world.x, world.R, world.R)
        np.testing.assert_array_equal(coupling.truth[~done], before[~done])
        shares.extend(coupling.truth[done])
    assert len(shares) > 200
    assert abs(np.mean(shares) - 0.3) < 4 * np.sqrt(0.3 * 0.7 / len(shares))


def test_the_estimate_runs_on_itself_whatever_the_policy_is_told() -> None:
    states = []
    for rho in (0.0, 1.0):
        coupling, world = make(ECRLConfig(rollout=100, rho_start=rho)), World()
        play(coupling, world, 15)
        states.append(coupling.state)
    for one, other in zip(*states, strict=True):
        assert torch.equal(one, other)


def test_an_episode_begins_with_the_given_orientation() -> None:
    coupling, world = make(ECRLConfig(rollout=100, rho_start=0.0)), World()
    play(coupling, world, 9)
    mask = np.arange(E) % 2 == 0
    before = coupling.state
    R0 = rotations.random_rotations(np.random.default_rng(5), E)
    coupling.start(mask, world.x, world.R, R0)
    np.testing.assert_array_equal(coupling.state.R[mask], R0[mask].astype(np.float32))
    np.testing.assert_array_equal(coupling.state.x[~mask], before.x[~mask])
    np.testing.assert_array_equal(
        coupling.state.latent[mask], coupling.estimator.latent0.detach().expand(3, -1)
    )


def test_episodes_may_begin_in_several_calls() -> None:
    coupling, world = make(ECRLConfig(rollout=2)), World()
    play(coupling, world, 1)
    first = np.arange(E) < 2
    coupling.start(first, world.x, world.R, world.R)
    coupling.start(~first, world.x, world.R, world.R)
    coupling.update(world.z, world.given, world.x, world.R)
    assert coupling.memory.recent[0].started[1].all()


def test_recordings_replay_to_the_states_that_were_lived() -> None:
    coupling, world = make(ECRLConfig(rollout=8, reuse=1, kept=3), RIGID), World()
    lived, truths = [], []
    world.begin(np.ones(E, bool))
    coupling.start(np.ones(E, bool), world.x, world.R, world.R)
    restarts = 0
    for _ in range(24):
        done = world.step()
        coupling.update(world.z, world.given, world.x, world.R)
        lived.append(coupling.state.R.clone())
        truths.append(world.R.copy())
        restarts += done.sum()
        world.begin(done)
        coupling.start(done, world.x, world.R, world.R)
    assert restarts > 5
    assert len(coupling.memory.recent) == 3
    with torch.no_grad():
        replayed = torch.cat(
            [unroll(coupling.estimator, part, coupling.encoding).after.R for part in coupling.memory.recent]
        )
    torch.testing.assert_close(replayed, torch.stack(lived))
    recorded = torch.cat([part.R for part in coupling.memory.recent])
    torch.testing.assert_close(recorded, torch.from_numpy(np.array(truths)).float())
    before = torch.cat([part.R_before for part in coupling.memory.recent])
    started = torch.cat([part.started for part in coupling.memory.recent])
    assert int(started[1:].sum()) in range(restarts - E, restarts + 1)
    assert torch.equal(before[1:][~started[1:]], recorded[:-1][~started[1:]])
    assert (before[1:][started[1:]] != recorded[:-1][started[1:]]).any()


def test_evaluation_records_nothing_and_never_tells_the_truth() -> None:
    coupling, world = make(ECRLConfig(rollout=3, rho_start=1.0)), World()
    coupling.training = False
    weights = [value.clone() for value in coupling.estimator.parameters()]
    play(coupling, world, 12)
    assert coupling.rho == 0
    assert not coupling.truth.any()
    assert not coupling.memory.tensors()
    assert coupling.iteration == 0
    assert all(torch.equal(a, b) for a, b in zip(weights, coupling.estimator.parameters(), strict=True))


def test_training_happens_every_rollout_and_rho_follows() -> None:
    coupling, world = make(), World()
    play(coupling, world, 14)
    assert coupling.iteration == 2
    assert coupling.rho == pytest.approx(0.3)
    metrics = coupling.metrics()
    assert metrics["rho"] == pytest.approx(0.3)
    assert 0 < metrics["estimator/angle_error"] < np.pi
    assert all(np.isfinite(value) for value in metrics.values())


def test_resume_is_exact() -> None:
    straight, world = make(), World()
    play(straight, world, 13)
    saved = straight.get_state()
    assert all(isinstance(value, np.ndarray) and value.dtype != object for value in saved.values())
    other, twin = make(seed=3), World()
    play(twin_coupling := make(), twin, 13)  # brings the twin world to the same point
    del twin_coupling
    other.set_state(saved)
    told = [play(coupling, place, 20, begin=False) for coupling, place in ((straight, world), (other, twin))]
    for one, two in zip(*told, strict=True):
        for a, b in zip(one, two, strict=True):
            np.testing.assert_array_equal(a, b)
    ends = straight.get_state(), other.get_state()
    assert ends[0].keys() == ends[1].keys()
    assert straight.iteration == 6
    for name, value in ends[0].items():
        np.testing.assert_array_equal(value, ends[1][name], err_msg=name)


def test_state_of_other_environments_is_refused() -> None:
    with pytest.raises(EstimatorError, match="6 environments, allowed: 4"):
        make(envs=4).set_state(make(envs=6).get_state())


def test_a_failed_step_leaves_no_trace() -> None:
    """Where physics failed there is nothing to learn from: garbage in that step changes neither state nor loss."""
    losses, states = [], []
    for garbage in (np.nan, 1e6):
        coupling, world = make(ECRLConfig(rollout=4, reuse=1), RIGID), World()
        world.begin(np.ones(E, bool))
        coupling.start(np.ones(E, bool), world.x, world.R, world.R)
        for step in range(4):
            world.step()
            valid = np.ones(E, bool)
            if step == 2:
                valid[1], world.z[1] = False, garbage
                world.x[1] = 0.0 if np.isnan(garbage) else 0.05
                before = coupling.state.x[1].clone()
            coupling.update(world.z, world.given, world.x, world.R, valid)
            if step == 2:
                assert torch.equal(coupling.state.x[1], before)
                world.x[1] = 0.0
                coupling.start(~valid, world.x, world.R, world.R)
        (recorded,) = coupling.memory.recent
        bps = coupling.trainer.bps
        losses.append(sequence_loss(coupling.estimator, recorded, coupling.encoding, bps))
        states.append(coupling.state)
    assert torch.isfinite(losses[0].loss)
    torch.testing.assert_close(losses[0].loss, losses[1].loss)
    torch.testing.assert_close(losses[0].position, losses[1].position)
    assert torch.equal(states[0].R, states[1].R)


def test_kalman_filter_takes_the_cells_place() -> None:
    table = boxes(CUBE, CUBOID)
    coupling = Coupling(KalmanFilter(), encoding("none", table), None, QUICK, E, seed=0)
    assert not coupling.training
    world = World()
    told = play(coupling, world, 6)
    x, R, sigma = told[-1]
    assert x.shape == (E, 3)
    assert np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max() < 1e-5
    assert sigma.min() > 0
    coupling.set_state(coupling.get_state())
    assert coupling.metrics() == {"rho": 0.0, "estimator/iteration": 0.0}


def test_the_coupling_learns_while_it_runs() -> None:
    torch.set_num_threads(1)
    config = EstimatorConfig.preset(
        "small", learning_rate=2e-3, transition_hidden=(96, 96), encoder_hidden=(64,)
    )
    coupling, world = make(ECRLConfig(rollout=12, reuse=4, kept=2), config, envs=32), World(envs=32)
    play(coupling, world, 12)
    first = coupling.metrics()
    play(coupling, world, 12 * 40, begin=False)
    last = coupling.metrics()
    assert last["estimator/angle_error"] < 0.6 * first["estimator/angle_error"]
    assert last["estimator/loss"] < first["estimator/loss"] - 1
