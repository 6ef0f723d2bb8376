"""Physics faults: noticed, told, contained, and written so that they can be played again."""

from __future__ import annotations

import dataclasses
import json
import pickle
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import randomization
from tactile_kit.simulation import dump as dumps
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.episode import FULL_RANGE, MIDDLE, Status
from tactile_kit.simulation.grasps import GraspBank
from tactile_kit.simulation.replay import replay
from tactile_kit.simulation.simulator import Simulator
from tactile_kit.simulation.vector import MAX_DUMPS, Blueprint, VectorSimulation

HORIZON = 10
INTO_FINGERS = (0.0, 0.05, 0.04)  # m from a grasp


def moved(bank: GraspBank, by: tuple[float, float, float]) -> GraspBank:
    """The same grasps with the object elsewhere: into the fingers."""
    return dataclasses.replace(bank, position=bank.position + np.array(by))


@pytest.fixture
def build(bodies, bank):
    made = []

    def make(bank: GraspBank = bank, preset: str = "default", **changes) -> Simulator:
        arguments = {"horizon": HORIZON, **changes}
        made.append(Simulator(SimulationConfig(), bodies, bank, randomization.preset(preset), **arguments))
        made[-1].reset(0, 5, 9.81)
        return made[-1]

    yield make
    for one in made:
        one.close()


def hold(simulator: Simulator) -> np.ndarray:
    return (simulator.world.command - MIDDLE) / FULL_RANGE


def state(simulator: Simulator) -> list[np.ndarray]:
    arrays = [np.zeros(144, np.float32), np.zeros(3), np.zeros((3, 3)), np.zeros(12)]
    simulator.read(*arrays)
    return arrays


def throw(simulator: Simulator) -> None:
    simulator.world.bullet.resetBaseVelocity(simulator.world.object, [0, 300, 0], [0, 0, 0])


def spin(simulator: Simulator) -> None:
    simulator.world.bullet.resetBasePositionAndOrientation(simulator.world.object, [0, 0, 1], [0, 0, 0, 1])
    simulator.world.bullet.resetBaseVelocity(simulator.world.object, [0, 0, 0], [5e3, 0, 0])


def explode(simulator: Simulator) -> None:
    simulator.world.hand.place(simulator.world.joints, np.full(16, 1e4))


def bury(simulator: Simulator) -> None:
    world = simulator.world
    position, orientation = world.bullet.getBasePositionAndOrientation(world.object)
    world.bullet.resetBasePositionAndOrientation(world.object, np.add(position, INTO_FINGERS), orientation)


def no_number(simulator: Simulator) -> None:
    world = simulator.world
    world.bullet.resetBaseVelocity(world.object, [np.nan] * 3, [0, 0, 0])


CAUSES = {throw: "m/s", spin: "rad/s", explode: "joint speed|m/s", bury: "mm inside", no_number: "nan"}


@pytest.mark.parametrize("cause", CAUSES, ids=lambda cause: cause.__name__)
def test_impossible_physics_is_a_fault_that_leaves_no_trace(build, cause: Callable) -> None:
    """The state stays the last good one, and the next episode is as if nothing had been."""
    simulator = build()
    action = hold(simulator)

    def course() -> list[bytes]:
        simulator.reset(1, 8, 9.81)
        return [
            b"".join(part.tobytes() for part in state(simulator))
            for _ in range(4)
            if not simulator.step(action)
        ]

    expected = course()
    simulator.reset(0, 5, 9.81)
    assert simulator.step(action) == Status.RUNNING
    before = state(simulator)
    cause(simulator)
    assert simulator.step(action) == Status.FAULT
    assert any(word in simulator.fault for word in CAUSES[cause].split("|")), simulator.fault
    for now, good in zip(state(simulator), before, strict=True):
        np.testing.assert_array_equal(now, good)
        assert np.isfinite(now).all()
    assert course() == expected and len(expected) == 4


def test_wild_actions_are_no_faults(build) -> None:
    """Limits are for what can't be: no episode of anybody's actions meets them."""
    simulator = build(horizon=100)
    rng = np.random.default_rng(0)
    for number in range(12):
        simulator.reset(number % 2, number, 9.81)
        status = Status.RUNNING
        while status == Status.RUNNING:
            status = simulator.step(np.sign(rng.uniform(-1, 1, 12)))
        assert status != Status.FAULT, simulator.fault


def test_a_fault_is_played_again_from_its_file(build, bank, tmp_path: Path) -> None:
    """Two faults of their own making: an action that is no number, and an object placed within the fingers."""
    broken = moved(bank, INTO_FINGERS)
    for name, make, wanted in (
        ("action", build, "not finite"),
        ("grasp", lambda: build(broken), "mm inside"),
    ):
        simulator = make()
        rng, status = np.random.default_rng(3), Status.RUNNING
        while status == Status.RUNNING:
            action = hold(simulator) + rng.normal(0, 0.1, 12)
            if name == "action" and simulator.elapsed == 3:
                action[2] = np.nan
            status = simulator.step(action)
        assert status == Status.FAULT and wanted in simulator.fault
        dumps.write(tmp_path / name, simulator.dump())
        found, other = dumps.read(tmp_path / name), make()
        assert (
            found.fault == simulator.fault
            and found.start["seed"] == 5
            and len(found.actions) == simulator.elapsed
        )
        assert replay(found, other) == Status.FAULT
        assert other.fault == found.fault and other.elapsed == simulator.elapsed
        for mine, theirs in zip(state(other), state(simulator), strict=True):
            np.testing.assert_array_equal(mine, theirs)


@pytest.fixture
def dump(build) -> dumps.Dump:
    simulator = build()
    simulator.step(hold(simulator))
    assert simulator.step(np.full(12, np.inf)) == Status.FAULT
    return simulator.dump()


def test_another_simulation_is_told_apart(build, dump: dumps.Dump) -> None:
    for other, match in (
        (build(horizon=11), "horizon: 10 -> 11"),
        (build(preset="none"), "joint_offset"),
    ):
        with pytest.raises(dumps.DumpError, match=match):
            replay(dump, other)
    with pytest.raises(dumps.DumpError, match="body: 'cube' -> None"):
        replay(dataclasses.replace(dump, start={**dump.start, "variant": 7}), build())
    bent = {**dump.state, "position": dump.state["position"] + 1e-9}
    with pytest.raises(dumps.DumpError, match="differs from the dump's in position"):
        replay(dataclasses.replace(dump, state=bent), build())


class Bomb:
    def __reduce__(self):
        return (pytest.fail, ("unpickled",))


def test_files_that_are_no_dumps_are_refused(dump: dumps.Dump, tmp_path: Path) -> None:
    path = tmp_path / "x.npz"

    def refused(match: str) -> None:
        with pytest.raises(dumps.DumpError, match=match) as caught:
            dumps.read(path)
        assert str(path) in str(caught.value)

    refused("No such file")
    for data in (b"", b"nonsense", pickle.dumps(Bomb())):
        path.write_bytes(data)
        refused("no dump")
    dumps.write(path, dump)
    path.write_bytes(path.read_bytes()[:-200])
    refused("no dump")
    dumps.write(path, dump)
    arrays = dict(np.load(path, allow_pickle=False))
    head = json.loads(str(arrays["head"]))
    for changes, match in (
        ({"head": np.array(json.dumps({**head, "schema": 2}))}, "schema 2, this version reads 1"),
        ({"head": np.array("[1]")}, "schema"),
        ({"head": np.array(json.dumps({**head, "start": {"seed": "0"}}))}, "start is"),
        ({"actions": arrays["actions"][:, 1:]}, "actions is"),
        ({"actions": np.float64(1)}, "actions is"),
        ({"state.joints": arrays["state.joints"].astype(np.float32)}, "float32"),
        ({"actions": np.array([Bomb()], dtype=object)}, "no dump"),
    ):
        np.savez(path, **{**arrays, **changes})
        refused(match)


def test_faults_are_kept_in_a_folder_that_does_not_grow_for_ever(bodies, bank, tmp_path: Path) -> None:
    blueprint = Blueprint(SimulationConfig(), bodies, bank, randomization.preset("none"), HORIZON)
    simulation = VectorSimulation(blueprint, 3, 0)
    simulation.faults = tmp_path / "faults"
    views = simulation.views
    views["next_seed"][:], views["next_gravity"][:] = [1, 2, 3], 9.81
    simulation.reset()
    views["action"][:], views["action"][1] = 0.0, np.nan
    ended = simulation.step_wait()
    assert set(ended[1]) == {"fault", "steps", "physics"}
    (file,) = simulation.faults.iterdir()
    assert dumps.read(file).start["seed"] == 2
    views["action"][:] = np.nan
    for _ in range(MAX_DUMPS // 3 + 3):
        simulation.step_wait()
    assert len(list(simulation.faults.iterdir())) == MAX_DUMPS
    simulation.faults = file  # no folder
    with pytest.warns(UserWarning, match="no dump of a fault could be written"):
        simulation.step_wait()
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # it is said once
        simulation.step_wait()
    simulation.close()
