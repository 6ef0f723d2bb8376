"""The compiled physics beside Bullet's: the same episodes, much the same motion, the same ends."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import randomization
from tactile_kit.hand import kinematics
from tactile_kit.shape import MeshTable
from tactile_kit.simulation.banks import grasps_of
from tactile_kit.simulation.compiled import CompiledSimulation
from tactile_kit.simulation.compiled import kernel as k
from tactile_kit.simulation.compiled.tables import distance_grids, hand_tables
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.simulator import FULL_RANGE, MIDDLE, Status
from tactile_kit.simulation.vector import Blueprint, VectorSimulation
from tactile_kit.task.rotations import geodesic

COUNT = 24


@pytest.fixture(scope="module")
def meshes(things) -> MeshTable:
    return MeshTable.from_meshes([(things[n].vertices, things[n].faces) for n in ("cube", "l_shape")])


@pytest.fixture(scope="module")
def many(things, own_cache):
    return grasps_of([things["cube"], things["l_shape"]], 12, SimulationConfig())


@pytest.fixture
def play(bodies, many, meshes):
    """Both engines, or the one asked for, over the same episodes."""
    made = []

    def make(engine, preset="none", count=COUNT, workers=1, gravity=9.81, horizon=50, **settings):
        config = SimulationConfig(engine=engine, **settings)
        blueprint = Blueprint(config, bodies, many, randomization.preset(preset), horizon, False)
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


def test_episodes_begin_as_in_bullet(play):
    ours, bullet = play("compiled").views, play("bullet").views
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
    simulation._place[:] = [0.0, 0.0, 2.0]
    start = simulation._place[:, 2].copy()
    advance(simulation, command(simulation)[None])
    fallen = start - simulation._place[:, 2]
    steps, dt = 6, 1 / 60
    np.testing.assert_allclose(fallen, 9.81 * dt * dt * steps * (steps + 1) / 2, rtol=1e-9)


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
    simulation._velocity[2, 0] = 50.0
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
    sticky = np.array([steps["sticky_action"][:10] for steps in simulation._steps])
    assert sticky.any()
    assert np.abs(simulation._parameters[:, k.FORCE : k.FORCE + 3]).max() > 0.001
    masses = simulation._parameters[:, k.MASS]
    assert masses.std() > 0.005


def test_the_horizon_ends_episodes(play):
    simulation = play("compiled", horizon=3)
    rows = advance(simulation, np.tile(command(simulation), (3, 1, 1)))
    assert not rows[1]["over"].any() and rows[2]["over"].all()
    assert (simulation.views["status"] == Status.TIME).all()


def test_grids_hold_the_distance(bodies, meshes, things):
    """Against trimesh's closest points, in the bodies' own frames."""
    import trimesh

    grids, first, spacing = distance_grids(bodies, meshes)
    generator, out = np.random.default_rng(0), np.empty(3)
    for index, name in enumerate(("cube", "l_shape")):
        body, thing = bodies[index], things[name]
        mesh = trimesh.Trimesh(thing.vertices, thing.faces, process=False)
        points = generator.uniform(first[index], first[index] + spacing[index] * 31, (300, 3))
        canonical = body.com + points @ body.axes.T
        closest, distance, _ = trimesh.proximity.closest_point(mesh, canonical)
        outside = ~mesh.contains(canonical) & (distance > 0.008) & (distance < 0.02)
        assert outside.sum() > 30
        for point, here, far, near in zip(
            points[outside], canonical[outside], distance[outside], closest[outside], strict=True
        ):
            found = k.lookup(grids[index], first[index], spacing[index], *point, out)
            assert found == pytest.approx(far, abs=6e-4)
            assert body.axes @ out @ ((here - near) / far) > 0.9


def test_beyond_the_grid_nothing_is_near(bodies, meshes):
    grids, first, spacing = distance_grids(bodies, meshes)
    assert k.lookup(grids[0], first[0], spacing[0], 0.5, 0.0, 0.0, np.empty(3)) == 1.0


def test_fingers_are_where_the_kinematics_say():
    base, lengths, *_ = hand_tables()
    joints = kinematics.MEAN_GRASP + 0.2 * np.random.default_rng(0).normal(size=12)
    axes, points, along = np.empty((2, 3)), np.empty((3, 3)), np.empty((3, 3))
    frames, tips = kinematics.link_frames(joints), kinematics.tip_centres(joints)
    for finger in range(4):
        k.pose_finger(base[finger], lengths, *joints[3 * finger : 3 * finger + 3], axes, points, along)
        np.testing.assert_allclose(axes, frames[finger, :2, :3, 2], atol=1e-12)
        np.testing.assert_allclose(points, frames[finger, 1:, :3, 3], atol=1e-12)
        tip = points[2] + kinematics.DISTAL.capsule.end * along[2]
        np.testing.assert_allclose(tip, tips[finger], atol=1e-12)


@pytest.mark.parametrize("environments", [0, -3])
def test_there_is_at_least_one_environment(bodies, many, meshes, environments):
    blueprint = Blueprint(
        SimulationConfig(engine="compiled"), bodies, many, randomization.preset("none"), 5, False
    )
    with pytest.raises(ValueError, match="1 and more"):
        CompiledSimulation(blueprint, meshes, environments, 1)


@pytest.mark.parametrize("engine", ["compiled", "bullet"])
def test_support_holds_what_no_finger_does(play, engine):
    """Weightless, in the open hand, an object pushed aside comes back to its place and stays."""
    opened = np.tile(kinematics.MEAN_GRASP - np.tile([0.0, 0.5, 0.3], 4), (COUNT, 1))
    ends = {}
    for support in (0.0, 200.0):
        simulation = play(engine, gravity=2.0, support=support, drag=support / 10)
        start = simulation.views["x0"].copy()
        rows = advance(simulation, np.tile(opened, (30, 1, 1)))
        ends[support] = np.where(rows[-1]["over"][:, None], 1.0, np.abs(rows[-1]["x"] - start))
    assert np.median(ends[200.0].max(axis=1)) < 0.01  # 0.4 N of weight left on 160 N/m
    assert np.median(ends[0.0].max(axis=1)) > 0.05


def test_full_gravity_knows_no_support(play):
    """At the earth's gravity support changes nothing, to the bit."""
    rows = []
    for support in (0.0, 200.0):
        simulation = play("compiled", support=support, drag=support / 10)
        rows.append(advance(simulation, wander(command(simulation), 6, 0.1))[-1])
    np.testing.assert_array_equal(rows[0]["x"], rows[1]["x"])


# the second and third finger would be 1 cm apart
CROSSED = kinematics.MEAN_GRASP.copy()
CROSSED[3:9] = [-0.5, 0.9, 0.6, 0.5, 0.9, 0.6]


def test_fingers_do_not_pass_through_each_other(play):
    simulation = play("compiled", count=4)
    simulation._place[:] = [0.0, 0.0, 2.0]  # nothing between them
    simulation._parameters[:, k.GRAVITY] = 0.0
    advance(simulation, np.tile(CROSSED, (12, 4, 1)))
    tips = kinematics.tip_centres(simulation._q[0].ravel())
    assert np.linalg.norm(tips[1] - tips[2]) > 2 * kinematics.DISTAL.capsule.radius - 1e-3


INTERPRETED = """
import sys
import numpy as np
from tactile_kit.simulation.compiled import kernel
data = np.load(sys.argv[1])
given = [tuple(data[f"hand{i}"] for i in range(10)) if n == 7 else data[f"{n}"] for n in range(28)]
assert not hasattr(kernel.control_step, "py_func")
kernel.control_step(*(int(g) if n in (0, 1, 4, 5) else g for n, g in enumerate(given)))
np.savez(sys.argv[2], **{f"{n}": g for n, g in enumerate(given) if n != 7})
"""


def test_compiled_it_computes_what_it_says(play, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same step by the interpreter, with fingers at the object and at each other."""
    simulation = play("compiled", preset="default", count=4)
    towards = np.tile(kinematics.MEAN_GRASP + np.tile([0.0, 0.6, 0.4], 4), (4, 1))
    towards[2] = CROSSED
    simulation._place[2, 2], simulation._parameters[2, k.GRAVITY] = 2.0, 0.0
    advance(simulation, np.tile(towards, (8, 1, 1)))
    calls, compiled = [], k.control_step
    monkeypatch.setattr(k, "control_step", lambda *given: calls.append(given))
    advance(simulation, towards[None])
    (given,) = calls
    arrays = {f"{n}": g for n, g in enumerate(given) if n != 7}
    np.savez(tmp_path / "in.npz", **arrays, **{f"hand{i}": table for i, table in enumerate(given[7])})
    compiled(*given)
    subprocess.run(
        [sys.executable, "-c", INTERPRETED, tmp_path / "in.npz", tmp_path / "out.npz"],
        timeout=240, check=True, env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
    )  # fmt: skip
    with np.load(tmp_path / "out.npz") as slow, np.load(tmp_path / "in.npz") as before:
        changed = [n for n in before.files if n in slow.files and not np.array_equal(before[n], slow[n])]
        assert len(changed) >= 8  # command, joints, speeds, pose, twist, impulses, measurements
        for n in changed:
            np.testing.assert_allclose(slow[n], given[int(n)], rtol=1e-5, atol=1e-7)


CODE = """
import hashlib
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
"""


def test_a_fresh_compilation_moves_as_the_one_on_disk(tmp_path: Path, own_cache: None) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", CODE]
    said = [
        subprocess.run(
            command, capture_output=True, text=True, timeout=240, check=True, env=environment
        ).stdout.split()
        for _ in range(2)
    ]
    assert [hits for hits, _ in said] == ["0", "1"]
    assert said[0][1] == said[1][1]


@pytest.mark.parametrize("engine", ["compiled", "bullet"])
def test_in_thick_air_things_sink_slowly(play, engine):
    """At the speed at which drag carries the weight, some 11 mm/s here."""
    opened = np.tile(kinematics.MEAN_GRASP - np.tile([0.0, 0.5, 0.3], 4), (COUNT, 1))
    simulation = play(engine, gravity=0.25, drag=20.0)
    start = simulation.views["x0"].copy()
    rows = advance(simulation, np.tile(opened, (25, 1, 1)))
    still = ~rows[-1]["over"]  # fingers that open throw some
    assert still.mean() > 0.7
    speed = ((rows[9]["x"] - rows[24]["x"])[:, 2] / 1.5)[still]
    kept = np.exp(-20 * (1 - 0.25 / 9.81) / 60)
    after = {"compiled": kept, "bullet": 1.0}[engine]  # drag comes after gravity, or before
    assert np.median(speed) == pytest.approx(after * 0.25 / 60 / (1 - kept), rel=0.05)
    assert np.median((start - rows[-1]["x"])[still, 2]) > 0.02
