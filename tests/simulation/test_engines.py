"""What holds for every engine: the same episodes begin, are disturbed and end in the same way."""

from __future__ import annotations

import numpy as np
import pytest

import randomization
from randomization import Randomization, Term, Uniform
from tactile_kit.shape import MeshTable
from tactile_kit.simulation.compiled import CompiledSimulation
from tactile_kit.simulation.compiled.batch import Batch
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.episode import EpisodeError, Status
from tactile_kit.simulation.hand import Hand
from tactile_kit.simulation.vector import Blueprint, VectorSimulation

ENGINES = {"bullet": 60, "compiled": 60, "mujoco": 600}  # and physics steps a second
COUNT, HORIZON = 4, 6
each_engine = pytest.mark.parametrize("engine", ENGINES)


@pytest.fixture
def build(bodies, bank, things):
    made = []

    def make(engine: str, preset: Randomization | str = "default", seed: int = 0, horizon: int = HORIZON):
        if engine == "mujoco":
            pytest.importorskip("mujoco")
        known = randomization.preset(preset) if isinstance(preset, str) else preset
        blueprint = Blueprint(
            SimulationConfig(engine=engine, steps_per_second=ENGINES[engine]), bodies, bank, known, horizon
        )
        if engine == "compiled":
            meshes = MeshTable.from_meshes(
                [(things[n].vertices, things[n].faces) for n in ("cube", "l_shape")]
            )
            made.append(CompiledSimulation(blueprint, meshes, COUNT, 1))
        else:
            made.append(VectorSimulation(blueprint, COUNT, 0))
        views = made[-1].views
        views["next_variant"][:] = np.arange(COUNT) % 2
        views["next_seed"][:] = seed + np.arange(COUNT)
        views["next_gravity"][:] = 9.81
        return made[-1]

    yield make
    for simulation in made:
        simulation.close()


def play(simulation, actions: np.ndarray) -> tuple[list[dict[str, np.ndarray]], dict[int, dict]]:
    """Views after each of the actions ``(T, E, 12)``, and what was told of the first end of each environment."""
    simulation.reset()
    shown, ends = [{name: view.copy() for name, view in simulation.views.items()}], {}
    for action in actions:
        simulation.views["action"][:] = action
        simulation.step_async()
        ended = simulation.step_wait()
        ends = {**ended, **ends}
        shown.append({name: view.copy() for name, view in simulation.views.items()})
    return shown, ends


def random_actions(steps: int) -> np.ndarray:
    return np.random.default_rng(1).uniform(-0.5, 0.5, (steps, COUNT, 12)).astype(np.float32)


@each_engine
def test_seeds_decide_every_bit(build, engine: str) -> None:
    actions = random_actions(HORIZON + 2)
    one, again, other = (play(build(engine, seed=seed), actions)[0] for seed in (0, 0, 9))
    for before, after in zip(one, again, strict=True):
        assert all(np.array_equal(before[name], after[name]) for name in before)
    assert not np.array_equal(one[1]["z"], other[1]["z"])


@pytest.mark.parametrize("engine", list(ENGINES)[1:])
def test_episodes_begin_alike(build, engine: str) -> None:
    """Object, grasp, encoders and noise-free measurements; and the physics told at the end is the same."""
    bullet, other = (play(build(each), random_actions(HORIZON)) for each in ("bullet", engine))
    for name, off in (("x0", 1e-6), ("R0", 1e-5), ("q0", 1e-6), ("z0", 1e-5)):
        np.testing.assert_allclose(bullet[0][0][name], other[0][0][name], atol=off, err_msg=name)
    assert bullet[1].keys() == other[1].keys()
    for e, end in bullet[1].items():
        told = other[1][e]["physics"]
        assert list(end["physics"]) == list(told)
        assert all(np.array_equal(end["physics"][name], told[name]) for name in told)


@each_engine
def test_the_horizon_a_drop_and_nonsense_end_an_episode(build, engine: str) -> None:
    actions = np.zeros((HORIZON, COUNT, 12), np.float32)
    actions[:, 1] = -1.0  # the hand opens
    actions[2, 2] = np.nan
    shown, ends = play(build(engine, "none", horizon=40), np.concatenate([actions] * 4))
    status = np.stack([views["status"] for views in shown[1:]])
    assert Status(status[2, 2]) == Status.FAULT and "not finite" in ends[2]["fault"] and ends[2]["steps"] == 3
    assert Status.DROP in status[:, 1] and ends[1]["fault"] is None
    assert all(np.isfinite(views[name]).all() for views in shown for name in ("z", "x", "R", "q"))
    _, ends = play(build(engine, "none", horizon=3), np.zeros((3, COUNT, 12), np.float32))
    assert {end["steps"] for end in ends.values()} == {3} and len(ends) == COUNT


@each_engine
def test_a_term_that_no_engine_knows_is_refused(build, engine: str) -> None:
    known = randomization.preset("default")
    for when in ("episode", "step", "interval:0.5"):
        wind = Term("wind", Uniform(0.0, 1.0), 1, "m/s", (0.0, 1.0), when, "", "")
        preset = Randomization("windy", [*known.terms.values(), wind])
        with pytest.raises(EpisodeError, match="no engine plays what 'windy' draws: wind"):
            build(engine, preset).reset()


@pytest.mark.parametrize(("engine", "part"), [("bullet", Hand), ("compiled", Batch)])
def test_an_engine_that_ignores_a_term_does_not_start(build, monkeypatch, engine: str, part: type) -> None:
    """The engine as it is, but for a default of its own in place of one of the terms."""
    takes = part.set_physics

    def forgetful(self, *given) -> None:
        *which, physics = given
        if engine == "compiled":
            takes(self, *which, [Forgetful(one) for one in physics])
        else:
            takes(self, Forgetful(physics))

    class Forgetful(dict):
        """Reads all but the friction of the tips from what it was made of."""

        def __init__(self, physics) -> None:
            super().__init__(physics)
            self.drawn = physics

        def __getitem__(self, name):
            return 0.5 if name == "tip_friction" else self.drawn[name]

    monkeypatch.setattr(part, "set_physics", forgetful)
    with pytest.raises(EpisodeError, match="ignores what is drawn: tip_friction"):
        build(engine).reset()
