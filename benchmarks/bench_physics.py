"""What a physics step and the solver's iterations do to the physics, each against the finest step.

    python benchmarks/bench_physics.py [--grasps 4] [--quick]

All objects at nominal size, no randomisation; every setting starts from the same grasps and gets the same commands:

- tries: the grasping heuristic on the same random orientations; the share that holds.
- rest: grasps held by a constant command for 5 s: creep, penetration, speeds that should be zero.
- motion: the command jumps to a new random place around the grasp every half second, for 3 s.
- free hand: the same commands without an object, beside the finest step's joint angles.
- energy: undriven fingers and a spinning object without gravity and friction, which should lose none.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from record import arguments, write

import object_sets
import randomization
from tactile_kit.evaluation.intervals import wilson
from tactile_kit.hand import kinematics
from tactile_kit.hand.controller import finger_mass_matrices
from tactile_kit.rotations import geodesic, random_rotations
from tactile_kit.simulation.banks import BulletFinder, find_banks
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.episode import dropped
from tactile_kit.simulation.grasps import GraspBank, try_grasp
from tactile_kit.simulation.world import Grasp, PhysicsFault, World

RATES = (60, 120, 240, 480, 960)  # Hz; the last is the reference
ITERATIONS = (20, 50, 100, 200)  # at 60 Hz
REST, MOTION, JUMP = 50, 30, 5  # control steps
SWING = 0.35  # rad, largest jump of a joint's command
AWAY = np.array([0.0, 0.0, -1.0])


class Scenes:
    """The bodies, grasps and commands that all settings share."""

    def __init__(self, grasps: int) -> None:
        self.things = object_sets.load("all")
        self.bodies = [Body(thing) for thing in self.things]
        self.count = grasps
        self.bank: GraspBank = find_banks(
            BulletFinder(grasps, SimulationConfig()), [[thing] for thing in self.things]
        )[1]
        self.physics = randomization.preset("none").draw("episode", 0)

    def __iter__(self) -> Any:
        for index, body in enumerate(self.bodies):
            for number in range(self.count):
                yield f"{body.name} {number}", body, self.bank.grasp(index, number)

    def commands(self, name: str, around: np.ndarray) -> np.ndarray:
        """Targets ``(MOTION, 12)`` rad."""
        generator = randomization.stream(0, "benchmark", "motion", name)
        jumps = SWING * generator.uniform(-1, 1, (MOTION // JUMP, kinematics.JOINTS))
        targets = around + np.repeat(jumps, JUMP, axis=0)
        return np.clip(targets, kinematics.JOINT_LOWER, kinematics.JOINT_UPPER)

    def orientations(self, body: Body) -> np.ndarray:
        return random_rotations(randomization.stream(0, "benchmark", "tries", body.name), self.count)


def rate(successes: int, of: int) -> dict[str, Any]:
    low, high = wilson(successes, of)
    return {"rate": successes / of, "low": low, "high": high, "n": of}


def deepest(world: World) -> float:
    """Deepest penetration of hand and object, m."""
    assert world.hand is not None
    return max((-contact[8] for contact in world.hand.contacts(world.object)), default=0.0)


def tendon_gap(world: World) -> float:
    """Largest difference of q3 and its passive q4, rad."""
    return float(np.abs(world.joints[2::4] - world.joints[3::4]).max())


def tries(world: World, scenes: Scenes) -> dict[str, Any]:
    held = [
        try_grasp(world, body, R) is not None for body in scenes.bodies for R in scenes.orientations(body)
    ]
    return {"tries_that_hold": rate(sum(held), len(held))}


def rest(world: World, scenes: Scenes) -> dict[str, Any]:
    held, creep, turn, speeds, depth, gaps, jitter = 0, [], [], [], [], [], []
    steps = 0
    start = time.thread_time()
    for _, body, grasp in scenes:
        world.load(body, scenes.physics)
        world.place(grasp)
        for step in range(REST):
            if step == 10:
                x, R = world.position, world.rotation
            world.step(grasp.command)
            steps += 1
            if dropped(world.position):
                break
            if step >= 10:
                speeds.append(world.speeds)
                depth.append(deepest(world))
                gaps.append(tendon_gap(world))
                jitter.append(np.linalg.norm(world.bullet.getBaseVelocity(world.object)[0]))
        else:
            held += 1
            seconds = (REST - 10) / 10
            creep.append(np.linalg.norm(world.position - x) / seconds)
            turn.append(float(geodesic(world.rotation, R)) / seconds)
    total = len(scenes.bodies) * scenes.count
    return {
        "cpu_milliseconds": (time.thread_time() - start) / steps * 1e3,
        "held_at_rest": rate(held, total),
        "creep_mm_s": quantiles(np.array(creep) * 1e3),
        "creep_deg_s": quantiles(np.rad2deg(turn)),
        "penetration_mm": quantiles(np.array(depth) * 1e3),
        "rest_joint_speed_rms": float(np.sqrt(np.mean(np.square(speeds)))),
        "rest_object_speed_rms_mm_s": float(np.sqrt(np.mean(np.square(jitter)))) * 1e3,
        "rest_tendon_gap_max": float(np.max(gaps)),
    }


def motion(world: World, scenes: Scenes) -> dict[str, Any]:
    kept, faults, speeds, depth, gaps = 0, 0, [], [], []
    for name, body, grasp in scenes:
        world.load(body, scenes.physics)
        world.place(grasp)
        try:
            for target in scenes.commands(name, grasp.command):
                world.step(target)
                if dropped(world.position):
                    break
                speeds.append(world.speeds[kinematics.DRIVEN_INDEX])
                depth.append(deepest(world))
                gaps.append(tendon_gap(world))
            else:
                kept += 1
        except PhysicsFault:
            faults += 1
    size = np.abs(np.concatenate(speeds))
    return {
        "held_in_motion": rate(kept, len(scenes.bodies) * scenes.count),
        "faults": faults,
        "joint_speed_rms": float(np.sqrt(np.mean(size**2))),
        "joint_speed_95": float(np.quantile(size, 0.95)),
        "joint_speed_max": float(size.max()),
        "motion_penetration_mm": quantiles(np.array(depth) * 1e3),
        "motion_tendon_gap_max": float(np.max(gaps)),
    }


def free_hand(world: World, scenes: Scenes) -> np.ndarray:
    """Joint angles ``(8 runs, MOTION, 16)`` of the hand alone, around the mean grasp."""
    start = kinematics.MEAN_GRASP
    tracks = []
    for run in range(8):
        world.load(scenes.bodies[0], scenes.physics)
        world.place(Grasp(kinematics.expand(start), start, AWAY, np.eye(3)))
        tracks.append([])
        for target in scenes.commands(f"free {run}", start):
            world.step(target)
            tracks[-1].append(world.joints)
    return np.array(tracks)


def energy_of_fingers(world: World, scenes: Scenes) -> float:
    """Share of their kinetic energy that swinging fingers gain or lose in 0.2 s."""
    still = {**scenes.physics, "gravity": 0.0, "stick_friction": np.zeros(kinematics.JOINTS)}
    world.load(scenes.bodies[0], still)
    start = kinematics.MEAN_GRASP
    world.place(Grasp(kinematics.expand(start), start, AWAY, np.eye(3)))
    speeds = kinematics.expand(np.tile([0.5, -1.0, 1.0], kinematics.FINGERS))  # away from each other
    assert world.hand is not None
    world.hand.place(kinematics.expand(start), speeds)
    before = kinetic(*world.hand.read())
    for _ in range(world.config.steps_per_second // 5):
        world.bullet.stepSimulation()
    return kinetic(*world.hand.read()) / before - 1


def kinetic(joints: np.ndarray, speeds: np.ndarray) -> float:
    """Kinetic energy of the hand, J; the drives' share does not depend on the posture."""
    matrix = kinematics.mass_matrix(joints[kinematics.DRIVEN_INDEX])
    drives = finger_mass_matrices() - blocks(kinematics.mass_matrix(kinematics.MEAN_GRASP))
    speeds = speeds.reshape(kinematics.FINGERS, 4)
    return 0.5 * float(np.einsum("fi,fij,fj->", speeds, blocks(matrix) + drives, speeds))


def blocks(matrix: np.ndarray) -> np.ndarray:
    return np.stack([matrix[i : i + 4, i : i + 4] for i in range(0, kinematics.ALL_JOINTS, 4)])


def energy_of_object(world: World, scenes: Scenes) -> float:
    """Share of its kinetic energy that an L, spinning at 3 rad/s about no principal axis, gains or loses in 5 s."""
    body = next(body for body in scenes.bodies if body.name == "l_shape")
    world.load(body, {**scenes.physics, "gravity": 0.0})
    world.place(Grasp(kinematics.expand(kinematics.MEAN_GRASP), kinematics.MEAN_GRASP, AWAY, np.eye(3)))
    world.bullet.resetBaseVelocity(world.object, [0, 0, 0], [2.0, 1.0, 2.0])

    def energy() -> float:
        _, quaternion = world.bullet.getBasePositionAndOrientation(world.object)
        axes = np.array(world.bullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
        spin = axes.T @ np.array(world.bullet.getBaseVelocity(world.object)[1])
        return 0.5 * float(spin @ (body.moments * spin))

    before = energy()
    for _ in range(5 * world.config.steps_per_second):
        world.bullet.stepSimulation()
    return energy() / before - 1


def quantiles(values: np.ndarray) -> dict[str, float]:
    if not len(values):
        return {}
    median, high, top = np.quantile(values, [0.5, 0.95, 1.0])
    return {"median": float(median), "q95": float(high), "max": float(top)}


def measure(config: SimulationConfig, scenes: Scenes) -> tuple[dict[str, Any], np.ndarray]:
    world = World(config)
    try:
        row = {"steps_per_second": config.steps_per_second, "solver_iterations": config.solver_iterations}
        row |= tries(world, scenes) | rest(world, scenes) | motion(world, scenes)
        row["energy_of_fingers"] = energy_of_fingers(world, scenes)
        row["energy_of_object"] = energy_of_object(world, scenes)
        return row, free_hand(world, scenes)
    finally:
        world.close()


def main() -> None:
    options = arguments(
        __doc__ or "",
        lambda parser: parser.add_argument("--grasps", type=int, default=4, help="an object"),
    )
    scenes = Scenes(1 if options.quick else options.grasps)
    default = SimulationConfig()
    settings = [default.model_copy(update={"steps_per_second": hz}) for hz in RATES]
    settings += [
        SimulationConfig(solver_iterations=number)
        for number in ITERATIONS
        if number != default.solver_iterations
    ]
    rows, tracks = [], []
    for config in settings:
        start = time.thread_time()
        row, track = measure(config, scenes)
        rows.append(row)
        tracks.append(track)
        taken = time.thread_time() - start
        print(
            f"{config.steps_per_second} Hz, {config.solver_iterations} iterations: {taken:.0f} s", flush=True
        )
    reference = tracks[RATES.index(max(RATES))]
    for row, track in zip(rows, tracks):
        error = np.abs(track - reference)
        row["free_hand_error"] = {
            "rms": float(np.sqrt(np.mean(error**2))),
            "max": float(error.max()),
        }
    results = {
        "settings": {"objects": len(scenes.bodies), "grasps_an_object": scenes.count, "swing": SWING},
        "rows": rows,
    }
    write("physics", results, options, ("pybullet", "numpy"))


if __name__ == "__main__":
    main()
