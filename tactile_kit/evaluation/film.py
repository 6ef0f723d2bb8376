"""Films of an agent at work: episodes played again, one picture a control step."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from randomization import derive
from tactile_kit.evaluation.errors import EvaluationError
from tactile_kit.evaluation.schedule import evaluation_task
from tactile_kit.task.goals import EpisodeSpec
from tactile_kit.task.rotations import octahedral

SUFFIXES = (".gif", ".mp4")
FRAMES_A_SECOND = 10  # real time: one picture a control step


def film(
    agent: Any, path: str | Path, *, objects: str = "cube", episodes: int = 1, seed: int = 0, size: int = 320
) -> int:
    """Writes a film of the agent turning objects to octahedral goals, and returns the number of pictures.

    A small inset shows the goal orientation. Episodes come from the evaluation's seeds.

    Args:
        agent: what ``tactile_kit.load_agent`` returns, or an agent's directory.
        path: film to write; ``.gif`` or ``.mp4``.
        objects: sets, names or ids; episodes go through them in turn.
        episodes: how many episodes.
        seed: of objects' grasps, goals and physics.
        size: edge of the picture in pixels.

    Raises:
        EvaluationError: a suffix other than .gif and .mp4, or a number out of range.
    """
    path = Path(path)
    if path.suffix not in SUFFIXES:
        raise EvaluationError(f"{path}: allowed are films ending in {' and '.join(SUFFIXES)}")
    if episodes < 1 or not 64 <= size <= 2048 or size % 16:
        raise EvaluationError(
            f"episodes = {episodes}, size = {size}; allowed are >= 1, and multiples of 16 from 64 to 2048"
        )
    import imageio.v3 as imageio

    from tactile_kit.agents.agent import load_agent
    from tactile_kit.task.variants import prepare

    if isinstance(agent, (str, Path)):
        agent = load_agent(agent)
    task = evaluation_task(agent.task, objects, seed)
    count = len(prepare(task))
    specs = []
    for number in range(episodes):
        child = derive(seed, "film", number)
        goal = octahedral()[1 + child % 23]  # never the identity, where nothing is to be done
        specs.append(EpisodeSpec(number % count, number % count, goal, child))
    pictures = _play(agent, task, specs, size)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".gif":
        imageio.imwrite(path, pictures, duration=1000 // FRAMES_A_SECOND, loop=0)
    else:
        imageio.imwrite(path, pictures, fps=FRAMES_A_SECOND, macro_block_size=16)
    return len(pictures)


def _play(agent: Any, task: Any, specs: list[EpisodeSpec], size: int) -> list[NDArray[np.uint8]]:
    from tactile_kit.simulation.camera import picture

    env = agent.make_env(config=task, num_envs=1, num_workers=0, seed=0, episodes=specs)
    (simulator,) = env.simulation.simulators
    simulator.world.visible = True
    pictures = []
    try:
        observation = env.reset()
        for number, spec in enumerate(specs):
            goal = _goal_inset(task, spec, size // 3)
            while env.results[number] is None:
                image = picture(simulator.world.bullet, size).copy()
                image[: len(goal), -len(goal) :] = goal
                pictures.append(image)
                observation, *_ = env.step(agent.act(observation))
    finally:
        env.close()
    return pictures


def _goal_inset(task: Any, spec: EpisodeSpec, size: int) -> NDArray[np.uint8]:
    """The object alone in its goal orientation, ``(size, size, 3)``."""
    from tactile_kit.simulation.bodies import Body
    from tactile_kit.simulation.camera import picture
    from tactile_kit.simulation.client import Client
    from tactile_kit.task.rotations import to_quaternion
    from tactile_kit.task.variants import prepare

    body, bullet = Body(prepare(task).objects[spec.variant]), Client()
    thing = body.create(bullet, 1.0, visible=True)
    position, rotation = body.to_bullet(np.zeros(3), spec.goal)
    bullet.resetBasePositionAndOrientation(thing, position.tolist(), to_quaternion(rotation).tolist())
    image = picture(bullet, size, distance=0.25, height=0.0).copy()
    bullet.disconnect()
    image[:2], image[-2:], image[:, :2], image[:, -2:] = 60, 60, 60, 60
    return image
