"""The kernel over lanes: what it computes, and that no environment feels another."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from physics_twin import HAND, Twin

import randomization
from tactile_kit.hand import kinematics
from tactile_kit.shape import MeshTable
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.compiled import Batch, kernel
from tactile_kit.simulation.compiled.lanes import LANES
from tactile_kit.simulation.compiled.rows import ROWS, SHAPES, SIZES, at
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.grasps import GraspBank

STATE = ("filtered", "q", "dq", "place", "quaternion", "velocity", "memory", "z", "deepest")
Make = Callable[..., Batch]


@pytest.fixture(scope="module")
def meshes(things) -> MeshTable:
    return MeshTable.from_meshes([(things[n].vertices, things[n].faces) for n in ("cube", "l_shape")])


@pytest.fixture
def make(bodies: list[Body], bank: GraspBank, meshes: MeshTable) -> Iterator[Make]:
    """A batch of the grasped cube and L with randomised physics; environment ``i`` is number ``numbers[i]`` of them."""
    made = []

    def build(numbers: Any, threads: int = 1, **settings: Any) -> Batch:
        numbers = np.asarray(numbers)
        batch = Batch(SimulationConfig(engine="compiled", **settings), bodies, meshes, len(numbers), threads)
        made.append(batch)
        variant, own = numbers % 2, numbers % 4 // 2
        grasps = bank.start[variant] + own
        everywhere = np.arange(len(numbers))
        batch.place(
            everywhere, variant, bank.joints[grasps][:, kinematics.DRIVEN_INDEX], bank.command[grasps],
            bank.position[grasps], bank.rotation[grasps],
        )  # fmt: skip
        drawn = [
            {**randomization.preset("default").draw("episode", n), "gravity": 9.81} for n in numbers.tolist()
        ]
        batch.set_physics(everywhere, drawn)
        return batch

    yield build
    for batch in made:
        batch.close()


def play(batch: Batch, numbers: Any, steps: int, first: int = 0) -> None:
    """Random targets and pushes; those of an environment are named by its number."""
    for step in range(first, first + steps):
        for e, number in enumerate(np.asarray(numbers).tolist()):
            generator = randomization.stream(number, "test", step)
            batch.now.target[..., e] = batch.now.filtered[..., e] + generator.normal(0, 0.15, (4, 3))
            batch.now.force[:, e] = generator.normal(0, 0.3, 3)
            batch.now.torque[:, e] = generator.normal(0, 0.002, 3)
        batch.step()


def test_it_computes_what_the_twin_says(make: Make) -> None:
    """Objects held and pushed, and fingers at each other in a hand whose object is away."""
    numbers = np.arange(12)
    batch = make(numbers)
    now = batch.now
    now.calm[6:] = 0.99
    now.place[2, 3], now.gravity[3] = 2.0, 0.0
    crossed = kinematics.MEAN_GRASP.reshape(4, 3).copy()
    crossed[1:3] = [[-0.5, 0.9, 0.6], [0.5, 0.9, 0.6]]
    touched, met = 0, False
    for first in range(0, 8, 2):
        play(batch, numbers, 2, first)
        now.target[..., 3] = crossed
        twins = [Twin(batch, e) for e in range(12)]
        batch.step()
        for e, twin in enumerate(twins):
            twin.control_step()
            touched += np.count_nonzero(np.abs(twin.memory).sum(axis=2))
            met |= bool(twin._pairs())
            for name in STATE:
                ours, theirs = getattr(now, name)[..., e], getattr(twin, name)
                if name == "quaternion":
                    theirs = theirs * np.sign(theirs @ ours)
                np.testing.assert_allclose(
                    ours, theirs, rtol=2e-3, atol=TOLERANCE[name], err_msg=f"{name} of {e}"
                )
    assert touched > 100 and met


TOLERANCE = {
    "filtered": 1e-6, "q": 2e-5, "dq": 1e-3, "place": 2e-6, "quaternion": 5e-5, "velocity": 5e-3, "memory": 5e-5,
    "z": 2e-5, "deepest": 2e-6,
}  # fmt: skip


def test_no_environment_feels_another(make: Make) -> None:
    """Each alone, in another order, in larger and smaller batches, over more threads: the same bytes."""
    numbers = np.arange(2 * LANES + 3)
    reference = make(numbers)
    play(reference, numbers, 6)
    shuffled = np.random.default_rng(0).permutation(numbers)
    for others, threads in (
        (shuffled, 1),
        (shuffled, 3),
        (numbers[::-1][: LANES + 5], 2),
        (numbers[7:8], 1),
        ([9] * 17, 1),
    ):
        batch = make(others, threads)
        play(batch, others, 6)
        for name in STATE:
            wanted = getattr(reference.now, name)[..., others]
            assert np.array_equal(bits(getattr(batch.now, name)), bits(wanted)), name


def bits(array: np.ndarray) -> np.ndarray:
    """Also tells zeros of either sign apart, and takes NaN as equal to itself."""
    return np.ascontiguousarray(array).view(np.uint32)


BROKEN: dict[str, Callable[[Any], None]] = {
    "a command that is no number": lambda now: now.target.__setitem__((..., 5), np.nan),
    "an infinite force": lambda now: now.force.__setitem__((..., 5), np.inf),
    "a huge force": lambda now: now.force.__setitem__((..., 5), 1e30),
    "a huge twist": lambda now: now.torque.__setitem__((..., 5), -1e12),
    "a speed beyond all bounds": lambda now: now.velocity.__setitem__((..., 5), 3e38),
    "a joint that is nowhere": lambda now: now.q.__setitem__((..., 5), np.nan),
    "an object that is nowhere": lambda now: now.place.__setitem__((..., 5), np.nan),
    "no orientation": lambda now: now.quaternion.__setitem__((..., 5), 0.0),
    "impulses beyond all bounds": lambda now: now.memory.__setitem__((..., 5), 1e38),
    "no mass": lambda now: now.mass.__setitem__(5, 0.0),
    "a grid without size": lambda now: now.cells.__setitem__((..., 5), np.nan),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_what_explodes_leaves_its_neighbours_alone(make: Make, fault: str) -> None:
    numbers = np.arange(LANES)
    left, right = make(numbers), make(numbers)
    play(left, numbers, 2), play(right, numbers, 2)
    for _ in range(3):
        BROKEN[fault](left.now)
        left.step(), right.step()
    others = np.delete(numbers, 5)
    for name in STATE:
        ours, theirs = getattr(left.now, name), getattr(right.now, name)
        assert np.array_equal(bits(ours[..., others]), bits(theirs[..., others])), name
    assert any(not np.array_equal(getattr(left.now, n)[..., 5], getattr(right.now, n)[..., 5]) for n in STATE)


def test_the_cache_knows_all_parts() -> None:
    """Numba sees changes of the entry's file alone: the others that it is made of have to be in its name on disk."""
    folder = Path(kernel.__file__).parent
    known = {part.stem for part in kernel.PARTS}
    for name in ("kernel", *known):
        for node in ast.walk(ast.parse((folder / f"{name}.py").read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(kernel.__package__ or "?"):
                assert (node.module or "").rsplit(".", 1)[1] in known


def test_rows_do_not_overlap() -> None:
    taken = np.zeros(ROWS, int)
    for name, first in zip(SHAPES, at, strict=True):
        taken[first : first + SIZES[name]] += 1
    assert (taken == 1).all()


def test_names_are_views_of_the_table(make: Make) -> None:
    batch = make([0, 1, 2])
    for number, name in enumerate(SHAPES):
        view = getattr(batch.now, name)
        assert view.shape == (*SHAPES[name], 3) and view.dtype == np.float32
        view[:] = number
    for number, name in enumerate(SHAPES):
        assert (getattr(batch.now, name) == number).all()


@pytest.mark.parametrize("variant", [-1, 2])
def test_there_are_no_other_objects(make: Make, variant: int) -> None:
    batch, joints = make([0, 1]), np.zeros((1, 12))
    with pytest.raises(ValueError, match="allowed are 0 to 1"):
        batch.place(
            np.array([1]), np.array([variant]), joints, joints, np.zeros((1, 3)), np.eye(3)[None]
        )  # the kernel would read past the grids


def test_undoing_a_step(make: Make) -> None:
    batch = make(np.arange(5))
    play(batch, np.arange(5), 2)
    before = {name: getattr(batch.now, name).copy() for name in STATE}
    play(batch, np.arange(5), 1, 2)
    after = batch.now.q.copy()
    batch.undo(np.array([1, 3]))
    for name in STATE:
        np.testing.assert_array_equal(getattr(batch.now, name)[..., [1, 3]], before[name][..., [1, 3]])
    np.testing.assert_array_equal(batch.now.q[..., [0, 2, 4]], after[..., [0, 2, 4]])


def test_poses_come_back(make: Make, bank: GraspBank) -> None:
    batch = make([0, 3])
    position, rotation = batch.pose(np.array([0, 1]))
    grasps = bank.start[[0, 1]] + [0, 1]
    np.testing.assert_allclose(position, bank.position[grasps], atol=1e-7)
    np.testing.assert_allclose(rotation, bank.rotation[grasps], atol=1e-6)


def test_grids_hold_the_distance(bodies, things, make: Make) -> None:
    """Against trimesh's closest points, in the bodies' own frames."""
    import trimesh

    generator, batch = np.random.default_rng(0), make([0, 1])
    _, first, spacing = batch.grids
    for index, name in enumerate(("cube", "l_shape")):
        body, thing, twin = bodies[index], things[name], Twin(batch, index)
        mesh = trimesh.Trimesh(thing.vertices, thing.faces, process=False)
        points = generator.uniform(first[index], first[index] + spacing[index] * 31, (300, 3))
        canonical = body.com + points @ body.axes.T
        closest, distance, _ = trimesh.proximity.closest_point(mesh, canonical)
        outside = ~mesh.contains(canonical) & (distance > 0.008) & (distance < 0.02)
        assert outside.sum() > 30
        for point, here, far, near in zip(
            points[outside], canonical[outside], distance[outside], closest[outside], strict=True
        ):
            found, direction = twin._look_up(point)
            assert found == pytest.approx(far, abs=6e-4)
            assert body.axes @ direction @ ((here - near) / far) > 0.9


def test_fingers_are_where_the_kinematics_say(make: Make) -> None:
    """Of the twin, which the kernel is held to."""
    twin = Twin(make([0]), 0)
    joints = kinematics.MEAN_GRASP + 0.2 * np.random.default_rng(0).normal(size=12)
    twin.q = joints.reshape(4, 3)
    twin._pose()
    frames, tips = kinematics.link_frames(joints), kinematics.tip_centres(joints)
    for finger in range(4):
        np.testing.assert_allclose(twin.axes[finger], frames[finger, :2, :3, 2], atol=1e-6)
        np.testing.assert_allclose(twin.points[finger], frames[finger, 1:, :3, 3], atol=1e-6)
        tip = twin.points[finger, 2] + kinematics.DISTAL.capsule.end * twin.along[finger, 2]
        np.testing.assert_allclose(tip, tips[finger], atol=1e-6)


def test_series_are_good_for_all_joint_angles() -> None:
    """Sine and cosine of the kernel hold below 2 rad."""
    assert max(np.abs(HAND.lower).max(), np.abs(HAND.upper).max()) < 2.0
