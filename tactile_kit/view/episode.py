"""Plays one episode in Bullet, as evaluations do, and keeps what there is to see."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_kit.rotations import octahedral
from tactile_kit.simulation.simulator import Simulator
from tactile_kit.task.goals import EpisodeSpec
from tactile_kit.view.choice import Choice
from tactile_kit.view.frames import NO_CONTACTS, STEP, Clip, Contacts, Frame, Pose

POINT, FORCE = 6, 9  # places in Bullet's contact tuple: on the object, world frame, and the normal force


class _Seen:
    """A simulator that remembers the contacts of its last step, which an episode's end would wipe out, and can push."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator, self._disturb = simulator, simulator.world.disturb
        self.force, self._drawn = np.zeros(3), (np.zeros(3), np.zeros(3))
        self.contacts = NO_CONTACTS
        setattr(simulator.world, "disturb", self._push)  # noqa: B010  # mypy lets no method be assigned

    def __getattr__(self, name: str) -> Any:
        return getattr(self._simulator, name)

    def _push(self, force: NDArray, torque: NDArray) -> None:
        """In place of the world's ``disturb``: the randomisation's disturbance and the push together."""
        self._drawn = force, torque
        self._disturb(force + self.force, torque)

    def step(self, action: NDArray) -> Any:
        world, pushed = self._simulator.world, bool(self.force.any())
        if pushed:
            self._push(*self._drawn)
        status = self._simulator.step(action)
        if world.hand is not None:  # a fault takes the hand away
            found = world.hand.contacts(world.object)
            points = np.array([contact[POINT] for contact in found]).reshape(-1, 3)
            self.contacts = Contacts(points, np.array([contact[FORCE] for contact in found]))
        if pushed:
            self.force = np.zeros(3)
            self._push(*self._drawn)
        return status


class Episode:
    """An episode that is played step by step.

    Attributes:
        clip: what was played so far; the start is there at once.
    """

    def __init__(self, agent: Any, task: Any, variants: Any, spec: EpisodeSpec) -> None:
        self.agent = agent
        self._env = agent.make_env(
            config=task, num_envs=1, num_workers=0, seed=0, episodes=[spec], variants=variants
        )
        try:
            simulators = self._env.simulation.simulators
            self._seen = simulators[0] = _Seen(simulators[0])
            things = self._env.variants.objects
            self.clip = Clip(
                agent.directory.name, things[spec.variant], things[spec.given], spec.goal, task.success_angle
            )
            self._observation = self._env.reset()
            state = self._env.state
            truth, joints = (
                Pose(state.x[0].copy(), state.R[0].copy()),
                self._env.simulation.views["q0"][0].copy(),
            )
            estimate, sigma = self._belief(self._env.belief)
            self.clip.frames.append(Frame(0.0, joints, truth, estimate, sigma))
        except BaseException:
            self._env.close()
            raise

    @classmethod
    def of(cls, agent: Any, choice: Choice) -> Episode:
        """The episode of a choice. Grasps that are not in the cache are looked for first: some seconds."""
        task = choice.task(agent.task)
        return cls(agent, task, choice.variants(task), choice.spec())

    @property
    def done(self) -> bool:
        return self.clip.outcome is not None

    def push(self, force: NDArray) -> None:
        """Push the object during the next step of 0.1 s: ``force (3,)`` N, world frame, beside what is drawn."""
        self._seen.force = np.asarray(force, dtype=np.float64)

    def step(self) -> Frame:
        """Play one control step more; after the end nothing happens."""
        if self.done:
            return self.clip.frames[-1]
        env, pushed = self._env, bool(self._seen.force.any())
        self._observation, *_ = env.step(self.agent.act(self._observation))
        last = env.transition
        truth, joints = Pose(last.x[0].copy(), last.R[0].copy()), env.simulation.views["q"][0].copy()
        estimate, sigma = self._belief(env.estimated if self.agent.estimator is not None else env.belief)
        time = STEP * len(self.clip.frames)
        frame = Frame(time, joints, truth, estimate, sigma, self._seen.contacts, pushed)
        self.clip.frames.append(frame)
        self.clip.outcome = env.results[0]
        return frame

    def close(self) -> None:
        """Disconnect from Bullet; the clip stays."""
        self._env.close()

    def _belief(self, belief: Any) -> tuple[Pose | None, NDArray | None]:
        if self.agent.estimator is None:
            return None, None
        pose = Pose(belief.x[0].astype(np.float64), belief.R[0].astype(np.float64))
        return pose, None if belief.sigma is None else belief.sigma[0].copy()


def goal_names() -> list[str]:
    """The 24 goals in words: axis and degrees, in the order of ``octahedral()``."""
    from scipy.spatial.transform import Rotation

    names = []
    for number, rotation in enumerate(octahedral()):
        vector = Rotation.from_matrix(rotation).as_rotvec(degrees=True)
        angle = np.linalg.norm(vector)
        axis = vector / angle if angle > 1 else np.zeros(3)
        steps = np.round(axis / max(np.abs(axis).max(), 1e-9)).astype(int)
        text = " ".join(f"{'-' if s < 0 else ''}{name}" for s, name in zip(steps, "xyz", strict=True) if s)
        names.append(f"{number}: {angle:.0f}° about {text}" if text else f"{number}: as it lies")
    return names
