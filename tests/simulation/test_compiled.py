"""The compiled physics beside Bullet's: the same episodes, much the same motion, the same ends."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import randomization
from tactile_kit.hand import kinematics
from tactile_kit.rotations import geodesic
from tactile_kit.shape import MeshTable
from tactile_kit.simulation.banks import BulletFinder, find_banks
from tactile_kit.simulation.compiled import CompiledSimulation
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.episode import FULL_RANGE, MIDDLE, Status
from tactile_kit.simulation.vector import Blueprint, VectorSimulation

COUNT = 24


@pytest.fixture(scope="module")
def meshes(things) -> MeshTable:
    return MeshTable.from_meshes([(things[n].vertices, things[n].faces) for n in ("cube", "l_shape")])


@pytest.fixture(scope="module")
def many(things, own_cache):
    return find_banks(BulletFinder(12, SimulationConfig()), [[things["cube"]], [things["l_shape"]]])[1]


@pytest.fixture
def play(bodies, many, meshes):
    """Both engines, or the one asked for, over the same episodes."""
    made = []

    def make(engine, preset="none", count=COUNT, workers=1, gravity=9.81, horizon=50, **settings):
        config = SimulationConfig(engine=engine, **settings)
        blueprint = Blueprint(config, bodies, many, randomization.preset(preset), horizon)
        if engine == "compiled":
            simulation = CompiledSimulation(blueprint, meshes, count, workers)
        else:
            simulation = VectorSimulation(blueprint, count, 0)
        made.append(simulation)
        simulation.views["next_variant"][:] = np.arange(count) % 2
        simulation.views["next_seed"][:] = np.arange(count)
        simulation.views["next_gravity"][:] = gravity
        simulation.reset()
        return simulation

    yield make
    for one in made:
        one.close()


def advance(simulation, targets):
    """Play targets ``(T, E, 12)`` rad; the state after each step, and whether the episode had ended by then."""
    views, over, rows = simulation.views, np.zeros(len(targets[0]), bool), []
    for target in targets:
        views["action"][:] = (target - MIDDLE) / FULL_RANGE
        simulation.step_async()
        simulation.step_wait()
        over |= views["status"] != Status.RUNNING
        rows.append({n: views[n].copy() for n in ("z", "x", "R", "q")} | {"over": over.copy()})
    return rows


def command(simulation):
    """The filtered command ``(E, 12)`` rad with which episodes begin."""
    z = simulation.views["z0"].reshape(-1, 6, 2, 12)
    return z[:, -1].sum(axis=1).astype(np.float64)


def wander(start, steps, size, seed=0):
    """Targets that stray from ``start`` by a random walk."""
    noise = np.random.default_rng(seed).normal(size=(steps, *start.shape))
    return np.clip(start + size * np.cumsum(noise, axis=0), kinematics.JOINT_LOWER, kinematics.JOINT_UPPER)


@pytest.mark.parametrize("preset", ["none", "default"])
def test_episodes_begin_as_in_bullet(play, preset):
    ours, bullet = play("compiled", preset).views, play("bullet", preset).views
    for name in ("z0", "x0", "R0", "q0"):
        np.testing.assert_allclose(ours[name], bullet[name], atol=1e-6)


def test_a_held_object_stays(play):
    simulation = play("compiled")
    start, steady = simulation.views["x0"].copy(), command(simulation)
    (*_, last) = advance(simulation, np.tile(steady, (40, 1, 1)))
    assert not last["over"].any()
    assert np.median(np.linalg.norm(last["x"] - start, axis=1)) < 1.5e-3


def test_it_moves_as_bullet_does(play):
    """Over half a second of random commands, the object moves and turns alike, and all of the joints do."""
    outcomes = []
    for engine in ("compiled", "bullet"):
        simulation = play(engine)
        targets = wander(command(simulation), 5, 0.12)
        outcomes.append(
            (simulation.views["x0"].copy(), simulation.views["R0"].copy(), advance(simulation, targets)[-1])
        )
    (x0, R0, ours), (_, _, bullet) = outcomes
    held = ~(ours["over"] | bullet["over"])
    assert held.mean() > 0.6
    moved = np.linalg.norm(bullet["x"] - x0, axis=1)[held]
    turned = geodesic(bullet["R"], R0)[held]
    apart = np.linalg.norm(ours["x"] - bullet["x"], axis=1)[held]
    astray = geodesic(ours["R"], bullet["R"])[held]
    assert np.median(apart) < 0.4 * np.median(moved)
    assert np.median(astray) < 0.4 * np.median(turned)
    assert np.abs(ours["q"] - bullet["q"])[held].mean() < 0.012


def test_it_drops_what_bullet_drops(play):
    """Wild commands for two seconds: as many drops, and mostly the same."""
    outcomes = []
    for engine in ("compiled", "bullet"):
        simulation = play(engine)
        outcomes.append(advance(simulation, wander(command(simulation), 20, 0.15))[-1]["over"])
    ours, bullet = outcomes
    assert bullet.any() and not bullet.all()
    assert abs(ours.mean() - bullet.mean()) < 0.25
    assert (ours == bullet).mean() > 0.7


def test_a_free_object_falls(play):
    """Without a hand that reaches it: 0.1 s of free fall, and a drop when it is 5 cm down."""
    simulation = play("compiled", horizon=20)
    height = simulation.batch.now.place[2]
    height[:] = 0.4
    advance(simulation, command(simulation)[None])
    steps, dt = 6, 1 / 60
    np.testing.assert_allclose(0.4 - height, 9.81 * dt * dt * steps * (steps + 1) / 2, rtol=1e-5)


def test_threads_change_nothing(play):
    rows = []
    for workers in (1, 2, 5):
        simulation = play("compiled", preset="default", workers=workers)
        rows.append(advance(simulation, wander(command(simulation), 12, 0.1)))
    for name in ("z", "x", "R", "q", "over"):
        for one, two, three in zip(*rows, strict=True):
            assert one[name].tobytes() == two[name].tobytes() == three[name].tobytes()


def test_what_is_not_finite_is_a_fault(play):
    simulation = play("compiled")
    steady = command(simulation)[None].copy()
    before = simulation.views["x0"].copy()
    steady[0, 3, 5] = np.nan
    simulation.views["action"][:] = (steady[0] - MIDDLE) / FULL_RANGE
    simulation.step_async()
    ended = simulation.step_wait()
    assert list(ended) == [3] and "not finite" in ended[3]["fault"]
    np.testing.assert_array_equal(simulation.views["x"][3], before[3])
    assert np.isfinite(simulation.views["z"]).all()


def test_an_object_thrown_about_is_a_fault(play):
    simulation = play("compiled")
    simulation.batch.now.velocity[0, 2] = 50.0
    simulation.views["action"][:] = (command(simulation) - MIDDLE) / FULL_RANGE
    simulation.step_async()
    ended = simulation.step_wait()
    assert "m/s" in ended[2]["fault"] and simulation.views["status"][2] == Status.FAULT


def test_randomisation_arrives(play):
    """Noise differs between the samples, sticky actions leave the target as it was, forces push."""
    simulation = play("compiled", preset="default")
    steady = command(simulation)
    rows = advance(simulation, wander(steady, 10, 0.05))
    angles = rows[0]["z"].reshape(COUNT, 6, 2, 12)[:, :, 0]
    assert np.abs(np.diff(angles, axis=1)).max() > 0.01
    now = simulation.batch.now
    assert np.abs(now.force).max() > 0.001
    assert now.mass.std() > 0.005
    targets = now.target.copy()
    advance(simulation, np.tile(steady + 0.1, (1, 1, 1)))
    stuck = (now.target == targets).all(axis=(0, 1))
    assert 0 < stuck.mean() < 0.5


def test_the_horizon_ends_episodes(play):
    simulation = play("compiled", horizon=3)
    rows = advance(simulation, np.tile(command(simulation), (3, 1, 1)))
    assert not rows[1]["over"].any() and rows[2]["over"].all()
    assert (simulation.views["status"] == Status.TIME).all()


@pytest.mark.parametrize("environments", [0, -3])
def test_there_is_at_least_one_environment(bodies, many, meshes, environments):
    blueprint = Blueprint(SimulationConfig(engine="compiled"), bodies, many, randomization.preset("none"), 5)
    with pytest.raises(ValueError, match="1 and more"):
        CompiledSimulation(blueprint, meshes, environments, 1)


def test_full_gravity_knows_no_thick_air(play):
    """At the earth's gravity drag changes nothing, to the bit."""
    rows = []
    for drag in (0.0, 20.0):
        simulation = play("compiled", drag=drag)
        rows.append(advance(simulation, wander(command(simulation), 6, 0.1))[-1])
    np.testing.assert_array_equal(rows[0]["x"], rows[1]["x"])


# the second and third finger would be 1 cm apart
CROSSED = kinematics.MEAN_GRASP.copy()
CROSSED[3:9] = [-0.5, 0.9, 0.6, 0.5, 0.9, 0.6]


def test_fingers_do_not_pass_through_each_other(play):
    simulation = play("compiled", count=4)
    now = simulation.batch.now
    now.place[2], now.gravity[:] = 2.0, 0.0  # nothing between them
    advance(simulation, np.tile(CROSSED, (12, 4, 1)))
    tips = kinematics.tip_centres(now.q[..., 0].ravel())
    assert np.linalg.norm(tips[1] - tips[2]) > 2 * kinematics.DISTAL.capsule.radius - 1e-3


CODE = """
import hashlib
import json
import numpy as np
import tactile_kit
from tactile_kit.simulation.compiled import kernel
env = tactile_kit.make_vec(
    objects="cube", randomization="none", grasps=2, num_envs=8, simulation={"engine": "compiled"}
)
env.reset()
digest, generator = hashlib.sha256(), np.random.default_rng(0)
for _ in range(10):
    env.step(generator.uniform(-0.6, 0.2, (8, 12)).astype(np.float32))
    digest.update(env.state.x.tobytes() + env.state.z.tobytes())
print(sum(kernel.control_step.stats.cache_hits.values()), digest.hexdigest())
print(json.dumps(env.state.z[:, -24:-12].tolist()))
"""


def run_anew(**environment: str) -> tuple[list[str], np.ndarray]:
    """Ten steps in a fresh process: cache hits and a digest of all states, and the last measured angles."""
    first, second = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, timeout=240, check=True,
        env={**os.environ, **environment},
    ).stdout.splitlines()[-2:]  # fmt: skip
    return first.split(), np.array(json.loads(second))


def test_a_fresh_compilation_moves_as_the_one_on_disk(tmp_path: Path, own_cache: None) -> None:
    said = [run_anew(NUMBA_CACHE_DIR=str(tmp_path))[0] for _ in range(2)]
    assert [hits for hits, _ in said] == ["0", "1"]
    assert said[0][1] == said[1][1]


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="names processors of this kind")
def test_narrow_registers_do_as_well(tmp_path: Path, own_cache: None) -> None:
    """As compiled for the oldest processor of 64 bits: four numbers a register, nothing fused, no gathers."""
    _, angles = run_anew()
    _, narrow = run_anew(NUMBA_CACHE_DIR=str(tmp_path), NUMBA_CPU_NAME="x86-64", NUMBA_CPU_FEATURES="")
    assert np.median(np.abs(narrow - angles)) < 1e-4
    assert np.abs(narrow - angles).max() < 0.05


def test_a_fault_stays_in_its_own_episode(play):
    """NaN and infinite actions and states that explode: their messages, and no byte of the others changed."""
    spoiled, clean = play("compiled", preset="default"), play("compiled", preset="default")
    targets = wander(command(clean), 6, 0.1)
    advance(spoiled, targets[:2]), advance(clean, targets[:2])
    others = np.delete(np.arange(COUNT), [1, 4, 7])
    for number, target in enumerate(targets[2:]):
        for simulation in (spoiled, clean):
            simulation.views["action"][:] = (target - MIDDLE) / FULL_RANGE
        if number == 0:
            spoiled.views["action"][1, 3], spoiled.views["action"][4] = np.nan, -np.inf
            spoiled.batch.now.dq[:, 1, 7] = 1e6
        for simulation in (spoiled, clean):
            simulation.step_async()
        ended = spoiled.step_wait()
        clean.step_wait()
        if number == 0:
            assert {1, 4, 7} <= set(ended)
            assert "not finite" in ended[1]["fault"] and "not finite" in ended[4]["fault"]
            assert "m/s" in ended[7]["fault"]
            assert (spoiled.views["status"][[1, 4, 7]] == Status.FAULT).all()
        for name in ("z", "x", "R", "q", "z0", "x0", "R0", "q0", "status"):
            assert spoiled.views[name][others].tobytes() == clean.views[name][others].tobytes()
        assert all(np.isfinite(spoiled.views[name]).all() for name in ("z", "x", "R", "q"))


def test_draws_are_those_of_bullets_episodes(play):
    """Noise, sticky actions and pushes of every control step."""
    compiled, bullet = (
        play("compiled", preset="default", horizon=12),
        play("bullet", preset="default", horizon=12),
    )
    for step in range(12):
        elapsed = np.full(COUNT, step)
        noise, sticky = compiled._draws.noise(elapsed), compiled._draws.sticky(elapsed)
        pushes = compiled._draws.pushes(elapsed)
        for e, simulator in enumerate(bullet.simulators):
            np.testing.assert_array_equal(noise[e], simulator.noise(step).ravel().astype(np.float32))
            assert sticky[e] == simulator.episode.sticky[step]
            for name, at in simulator.episode.pushed(step).items():
                np.testing.assert_array_equal(pushes[name][e], simulator.episode.pushes[name][at])


def test_in_thick_air_things_sink_slowly(play):
    """At the speed at which drag carries the weight, some 11 mm/s here."""
    opened = np.tile(kinematics.MEAN_GRASP - np.tile([0.0, 0.5, 0.3], 4), (COUNT, 1))
    simulation = play("compiled", gravity=0.25, drag=20.0)
    start = simulation.views["x0"].copy()
    rows = advance(simulation, np.tile(opened, (25, 1, 1)))
    still = ~rows[-1]["over"]  # fingers that open throw some
    assert still.mean() > 0.7
    speed = ((rows[9]["x"] - rows[24]["x"])[:, 2] / 1.5)[still]
    kept = np.exp(-20 * (1 - 0.25 / 9.81) / 60)
    assert np.median(speed) == pytest.approx(kept * 0.25 / 60 / (1 - kept), rel=0.05)
    assert np.median((start - rows[-1]["x"])[still, 2]) > 0.02
