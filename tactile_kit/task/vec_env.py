"""The batched environment: E environments over W worker processes, as a Stable-Baselines3 ``VecEnv``.

Workers simulate; everything that can be batched (goals, rewards, beliefs, shape encodings, observations) happens here.
Results don't depend on the number of workers.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from tactile_kit.hand.kinematics import JOINTS
from tactile_kit.rotations import geodesic
from tactile_kit.simulation import batches
from tactile_kit.simulation.episode import Status
from tactile_kit.task.actions import checked, for_simulator
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.core import Core
from tactile_kit.task.episodes import Episodes
from tactile_kit.task.goals import EpisodeSpec
from tactile_kit.task.observation import Belief
from tactile_kit.task.reward import reward_terms
from tactile_kit.task.state import EpisodeResult, State, Transition
from tactile_kit.task.variants import Variants, prepare

if TYPE_CHECKING:
    from tactile_kit.simulation.compiled import CompiledSimulation
    from tactile_kit.simulation.vector import VectorSimulation

Array = NDArray[Any]


def simulation_of(
    core: Core, num_envs: int, num_workers: int, workers: str = "processes"
) -> VectorSimulation | CompiledSimulation:
    """The physics that the task's settings ask for."""
    physics = core.config.simulation
    return batches.simulation_of(physics, core.blueprint, core.meshes, num_envs, num_workers, workers)


class ReorientVecEnv(VecEnv):
    """E environments of the reorientation task; the policy is told the true object pose (oracle).

    Args:
        config: the task.
        num_envs: environments.
        num_workers: worker processes, of a search for grasps too; 0 simulates in this process.
        seed: names the training episodes.
        episodes: play exactly these, each once (evaluation); finished environments take the next of the list, and
            ``results`` fills up in its order. Without it, training episodes never end.
        variants: prepared bodies to share between environments.
        workers: what the workers are: ``processes`` of this machine, or ``ray``: actors on all machines that Ray has.
            Results don't depend on it.
    """

    render_mode = None
    sigma = False  # whether beliefs come with uncertainties

    def __init__(
        self,
        config: TaskConfig,
        *,
        num_envs: int,
        num_workers: int = 1,
        seed: int = 0,
        episodes: Iterable[EpisodeSpec] | None = None,
        variants: Variants | None = None,
        workers: str = "processes",
    ) -> None:
        core = Core(
            config,
            sigma=self.sigma and config.sigma_in_observation,
            variants=variants or prepare(config, num_workers),
        )
        self.core, self.config = core, config
        self.layout, self.variants, self.meshes, self.encoding = (
            core.layout,
            core.variants,
            core.meshes,
            core.encoding,
        )
        super().__init__(
            num_envs,
            spaces.Box(-np.inf, np.inf, (self.layout.size,), np.float32),
            spaces.Box(-1.0, 1.0, (JOINTS,), np.float32),
        )
        self.simulation = simulation_of(core, num_envs, num_workers, workers)
        try:
            self.episodes = Episodes(config, core.variants, num_envs, self.simulation.views, seed, episodes)
        except BaseException:
            self.close()  # the workers are running already
            raise
        self._theta, self._theta_min = np.zeros(num_envs), np.zeros(num_envs)  # angles to the goal, rad
        self._return = np.zeros(num_envs)
        self.state = State.blank(num_envs)
        self.belief = Belief(
            np.zeros((num_envs, 3), np.float32), np.tile(np.eye(3, dtype=np.float32), (num_envs, 1, 1))
        )
        self.transition: Transition | None = None
        self.episode_count = 0

    # -- episodes ---------------------------------------------------------------------------------------------------

    def get_state(self) -> dict[str, Array]:
        """What :meth:`set_state` needs to go on with the same training episodes; physics is not in it."""
        return {"next_episode": self.episodes.upcoming}

    def set_state(self, arrays: dict[str, Array]) -> None:
        """Go on with the episodes that were announced when the state was taken, from the next ``reset`` on.

        Raises:
            ValueError: the state is of another number of environments, or of episodes before the first.
        """
        numbers = np.asarray(arrays["next_episode"], np.int64)
        if numbers.shape != (self.num_envs,):
            raise ValueError(f"state of {numbers.size} environments: allowed are {self.num_envs}")
        if numbers.min() < 0:
            raise ValueError(f"next episode {numbers.min()}: allowed are 0 and more")
        self.episodes.reseed(self.episodes.seed, numbers)

    def _begin(self, mask: Array) -> None:
        """Take over the first states of new episodes and announce the following ones."""
        views, state, rows = self.simulation.views, self.state, np.flatnonzero(mask)
        for i in rows.tolist():
            spec = self.episodes.begin(i)
            state.goal[i], state.given[i], state.variant[i] = spec.goal, spec.given, spec.variant
        for name in ("z", "x", "R"):
            getattr(state, name)[rows] = views[name + "0"][rows]
        state.x0[rows], state.R0[rows] = views["x0"][rows], views["R0"][rows]
        state.elapsed[rows], self._return[rows] = 0, 0.0
        self._theta[rows] = self._theta_min[rows] = geodesic(state.R[rows], state.goal[rows])

    @property
    def finished(self) -> bool:
        """Whether every listed episode has its result."""
        return self.episodes.finished

    @property
    def results(self) -> list[EpisodeResult | None]:
        """Of the listed episodes, in their order; None: not played yet."""
        return self.episodes.results

    @property
    def gravity(self) -> float:
        """m/s^2, of the episodes to come."""
        return self.episodes.gravity

    def set_gravity(self, gravity: float) -> None:
        """Gravity in m/s^2 of the episodes that start from now on (those already announced included)."""
        self.episodes.set_gravity(gravity)

    # -- belief: the oracle's is the truth ------------------------------------------------------------------------

    def _start_belief(self, mask: Array) -> Belief:
        """Belief of all environments when those of ``mask`` have just begun an episode (``state`` holds it)."""
        return self._true_belief()

    def _update_belief(self) -> Belief:
        """Belief of all environments after a step (``state`` holds the outcome, terminal where an episode ended)."""
        return self._true_belief()

    def _true_belief(self) -> Belief:
        return Belief(self.state.x.astype(np.float32), self.state.R.astype(np.float32))

    def _observe(self) -> Array:
        return self.core.observer(self.state.z, self.state.goal, self.belief, self.state.given)

    def _observe_again(self, observation: Array, rows: Array) -> Array:
        """``observation (E, D)`` with the environments ``rows (N,)`` as they are now, in an array of its own."""
        state, observation = self.state, observation.copy()
        observation[rows] = self.core.observer(
            state.z[rows], state.goal[rows], self.belief.of(rows), state.given[rows]
        )
        return observation

    # -- VecEnv -----------------------------------------------------------------------------------------------------

    def reset(self) -> Array:
        """Begin episodes everywhere, a list of episodes at its start; ``(E, D) float32``."""
        if self.episodes.listed is not None:
            self.episodes.announce()
        self.simulation.reset()
        everywhere = np.ones(self.num_envs, bool)
        self._begin(everywhere)
        self.belief = self._start_belief(everywhere)
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return self._observe()

    def step_async(self, actions: Array) -> None:
        """Send actions ``(E, 12)`` in [-1, 1] to the workers; raises ``ActionError`` where they have another shape.

        Where one is not finite, that environment's episode ends as a fault (``infos[i]["fault"]``), the others go on.
        """
        actions = checked(actions, (self.num_envs, JOINTS), finite=False)
        self.simulation.views["action"][:] = for_simulator(self.config, actions, self.state.z)
        self.simulation.step_async()

    def step_wait(self) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        """Observations ``(E, D)``, rewards ``(E,)``, dones ``(E,)`` and infos (filled where an episode ended)."""
        ended = self.simulation.step_wait()
        views, state = self.simulation.views, self.state
        x_before = state.x.copy()
        state.z[:], state.x[:], state.R[:] = views["z"], views["x"], views["R"]
        state.elapsed += 1
        status = views["status"]
        truncated = status == Status.TIME
        terminated = (status == Status.DROP) | (status == Status.FAULT)
        theta_before, self._theta = self._theta, geodesic(state.R, state.goal)
        terms = reward_terms(
            self.config.reward, theta_before, self._theta, x_before, state.x, state.x0, views["q"], terminated
        )
        reward = np.sum(list(terms.values()), axis=0).astype(np.float32)
        done = truncated | terminated
        self._theta_min = np.minimum(self._theta_min, self._theta)
        self._return += reward
        self.belief = self._update_belief()
        observation = self._observe()
        self.transition = Transition(state.R.copy(), state.x.copy(), state.goal.copy(), terms)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(done).tolist():
            infos[i] = self._finish(i, Status(int(status[i])), ended[i], observation[i])
        if done.any():
            self._begin(done)
            self.belief = self._start_belief(done)
            observation = self._observe_again(observation, np.flatnonzero(done))
        return observation, reward, done, infos

    def _finish(self, i: int, status: Status, ended: dict[str, Any], observation: Array) -> dict[str, Any]:
        theta = self._theta[i]
        success = bool(status == Status.TIME and theta < self.config.success_angle)
        result = EpisodeResult(
            self.episodes.present[i], float(theta), float(self._theta_min[i]), success, status == Status.DROP,
            ended["fault"], ended["steps"], float(self._return[i]),
        )  # fmt: skip
        self.episodes.end(i, result)
        self.episode_count += 1
        return {
            "terminal_observation": observation.copy(),
            "TimeLimit.truncated": status == Status.TIME,
            "episode": {"r": result.reward, "l": result.steps},
            "success": success,
            "theta": result.theta,
            "theta_min": result.theta_min,
            "drop": result.drop,
            "fault": result.fault,
            "variant": result.spec.variant,
            "given": result.spec.given,
            "goal": result.spec.goal,
            "seed": result.spec.seed,
            "randomization": ended["physics"],
        }

    def close(self) -> None:
        """End the workers."""
        self.simulation.close()

    # -- the rest of SB3's interface ------------------------------------------------------------------------------

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute, once an environment."""
        return [getattr(self, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not supported: environments have no state of their own to set."""
        raise AttributeError(f"{type(self).__name__}.{attr_name} can't be set from outside")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Not supported: there are no environment objects behind the batch."""
        raise AttributeError(f"{type(self).__name__} has no environment objects with {method_name!r}")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Never wrapped."""
        return [False] * len(list(self._get_indices(indices)))

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """From the next ``reset`` on, training episodes follow from ``seed``; a list of episodes stays as it is.

        SB3's learners call this with theirs. With None nothing changes.
        """
        if seed is not None and self.episodes.listed is None:
            self.episodes.reseed(seed)
        return [self.episodes.seed] * self.num_envs

    def __reduce__(self) -> tuple:
        """Not supported, and said so: pickle and deepcopy end here."""
        raise TypeError(
            f"{type(self).__name__} can't be copied or pickled: its physics live in worker processes; make another "
            "from its config and episodes.seed, and hand on get_state()"
        )


def make_vec(config: TaskConfig | None = None, **settings: Any) -> ReorientVecEnv:
    """The batched environment from a task or from single settings of one.

    ``num_envs``, ``num_workers``, ``workers``, ``seed`` and ``episodes`` go to :class:`ReorientVecEnv`, everything
    else to :class:`TaskConfig`. ``render_mode`` may be given as None, as other makers take it.

    Raises:
        ValueError: another ``render_mode``: the batch has no pictures, the single environment has.
    """
    if (mode := settings.pop("render_mode", None)) is not None:
        raise ValueError(
            f"render_mode = {mode!r}: allowed is None; a single environment draws: "
            "gymnasium.make('tactile_kit/Reorient-v0', render_mode='rgb_array')"
        )
    own = {
        name: settings.pop(name)
        for name in ("num_envs", "num_workers", "seed", "episodes", "workers")
        if name in settings
    }
    config = (config or TaskConfig()).changed(settings)
    return ReorientVecEnv(config, **{"num_envs": 16, **own})


__all__ = ["Belief", "EpisodeResult", "EpisodeSpec", "ReorientVecEnv", "State", "Transition", "make_vec"]
