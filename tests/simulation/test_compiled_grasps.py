"""Grasps of the compiled physics: the same tries and recipe as in Bullet, and Bullet holds what they hold."""

from __future__ import annotations

import numpy as np
import pytest

import randomization
from tactile_kit.evaluation.schedule import evaluation_task
from tactile_kit.hand import kinematics
from tactile_kit.rotations import geodesic, random_rotations
from tactile_kit.shape import MeshTable
from tactile_kit.simulation.banks import bank_file
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.compiled import grasping
from tactile_kit.simulation.compiled.grasping import CompiledFinder, try_grasps
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.episode import dropped
from tactile_kit.simulation.grasps import GraspError, Tries, draw_tries, try_grasp
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.variants import finder_of, prepare

SPREAD = 0.1


def try_all(thing, tries: Tries) -> list:
    meshes = MeshTable.from_meshes([(thing.vertices, thing.faces)])
    return try_grasps(SimulationConfig(), [Body(thing)], meshes, tries)


def test_tries_are_drawn_one_after_another(things) -> None:
    """Spelled out: both searches see the numbers that banks of Bullet were always found with."""
    cube = things["cube"]
    generator = randomization.stream(3, "grasps", cube.digest)
    rotations = random_rotations(generator, 20)
    tries = draw_tries(cube, 2, 3, 10, SPREAD)
    np.testing.assert_array_equal(tries.rotation, rotations)
    for number in range(20):
        stray = SPREAD * generator.uniform(-1, 1, (4, 3)) * [1.0, 0.5, 0.5]
        idle = generator.integers(12)
        np.testing.assert_array_equal(tries.offset[number], stray.ravel())
        assert tries.closing[number].tolist() == [finger != idle for finger in range(4)]
    plain = draw_tries(cube, 2, 3, 10, 0.0)
    assert (plain.rotation == rotations).all() and not plain.offset.any() and plain.closing.all()


def test_the_hand_closes_as_in_bullet(things, make_world) -> None:
    """The same tries end in nearly the same grasps, where both physics hold them."""
    cube = things["cube"]
    tries, world, body = draw_tries(cube, 16, 0, 1, SPREAD), make_world(), Body(cube)
    theirs = [
        try_grasp(world, body, *one) for one in zip(tries.rotation, tries.offset, tries.closing, strict=True)
    ]
    agree, apart, turned = 0, [], []
    for number, other in enumerate(theirs):
        ours = try_all(cube, tries.part(number, number + 1))
        agree += bool(ours) == (other is not None)
        if ours and other is not None:
            apart.append(np.abs(ours[0].command - other.command).max())
            turned.append(geodesic(ours[0].rotation, other.rotation))
    assert agree >= 11 and len(apart) >= 8
    assert np.median(apart) < 0.1 and np.median(turned) < 0.1


def test_bullet_holds_what_the_compiled_physics_holds(things, make_world, physics) -> None:
    """For a second, at the step of evaluations; docs/speed.md has the share over many more."""
    world, held, fell, count = make_world(steps_per_second=120), 0, 0, 0
    for name in ("cube", "l_shape"):
        thing = things[name]
        body = Body(thing)
        for grasp in CompiledFinder(12, SimulationConfig(), spread=SPREAD).find(thing):
            world.load(body, physics)
            world.place(grasp)
            for _ in range(10):
                world.step(grasp.command)
            fell += dropped(world.position)
            held += (
                np.linalg.norm(world.position - grasp.position) < 5e-3
                and geodesic(world.rotation, grasp.rotation) < 0.15
            )
            count += 1
            driven = grasp.joints[kinematics.DRIVEN_INDEX]
            assert (driven > kinematics.JOINT_LOWER - 0.02).all()
            assert (driven < kinematics.JOINT_UPPER + 0.02).all()
    assert count == 24 and held >= 20 and fell <= 1


def test_what_is_found_does_not_depend_on_what_is_tried_beside_it(things, monkeypatch) -> None:
    finder = CompiledFinder(6, SimulationConfig(), spread=SPREAD)
    found = []
    for together in (1, 16, 40):
        monkeypatch.setattr(grasping, "TOGETHER", together)
        found.append(finder.find(things["l_shape"]))
    for grasps in found[1:]:
        for one, other in zip(found[0], grasps, strict=True):
            for name, value in vars(one).items():
                np.testing.assert_array_equal(value, getattr(other, name))


def test_a_grasp_holds_with_less_friction(things, monkeypatch) -> None:
    """Fewer tries hold than with all of it, and none with next to nothing."""
    tries, held = draw_tries(things["cut_cube"], 48, 0, 1, SPREAD), []
    for margin in (1.0, grasping.MARGIN, 0.02):
        monkeypatch.setattr(grasping, "MARGIN", margin)
        held.append(len(try_all(things["cut_cube"], tries)))
    assert held[0] > held[1] > held[2] == 0


def test_what_can_not_be_held_is_an_error(things) -> None:
    thing = things["cube"].with_extents([0.002, 0.002, 0.002])
    with pytest.raises(GraspError, match=r"cube with extents \[2. 2. 2.\] mm: 0 of 1 .* 3 tries"):
        CompiledFinder(1, SimulationConfig(), attempts=3).find(thing)


def test_an_object_inside_the_open_hand_is_no_grasp(things) -> None:
    big = things["cube"].with_extents(
        [0.13] * 3
    )  # reaches the fingertips, which would hold it once pushed out
    tries = Tries(np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 12)), np.ones((2, 4), bool))
    assert try_all(big, tries) == []


def test_each_physics_has_its_own_bank_and_evaluations_have_bullets(things) -> None:
    compiled = TaskConfig(simulation={"engine": "compiled", "drag": 20.0}, grasp_spread=SPREAD)
    bullet = TaskConfig(grasp_spread=SPREAD)
    cube = things["cube"]
    assert bank_file(finder_of(compiled), cube) != bank_file(finder_of(bullet), cube)
    files = [bank_file(finder_of(evaluation_task(task, "cube", 0)), cube) for task in (compiled, bullet)]
    assert files[0] == files[1]


@pytest.mark.slow
def test_the_number_of_workers_is_no_matter(tmp_path, monkeypatch) -> None:
    task = TaskConfig(
        objects="cube,l_shape", scaling="random", variants=1, grasps=4, simulation={"engine": "compiled"}
    )
    monkeypatch.setattr(CompiledFinder, "worth", 1)
    found = []
    for workers in (1, 2):
        monkeypatch.setenv("TACTILE_KIT_CACHE", str(tmp_path / str(workers)))
        prepare(task, workers)
        files = (tmp_path / str(workers) / "grasps").iterdir()
        found.append({path.name: path.read_bytes() for path in files})
    assert found[0] == found[1] and len(found[0]) == 4
