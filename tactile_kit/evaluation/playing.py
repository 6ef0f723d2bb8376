"""Plays what files of courses hold: episodes second by second, on request with estimators that only follow."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from randomization import derive
from tactile_kit.evaluation.chorus import Chorus
from tactile_kit.evaluation.courses import MOMENTS, Moment
from tactile_kit.evaluation.rows import SUCCESS_ANGLE
from tactile_kit.evaluation.schedule import HORIZON, schedule
from tactile_kit.evaluation.symmetry import Symmetry, symmetry_of
from tactile_kit.rotations import geodesic
from tactile_kit.simulation.config import CONTROL_RATE

ENVIRONMENTS = 52  # at a time


def play(
    agent: Any,
    condition: str,
    moments: Sequence[float] = MOMENTS,
    progress: Callable[[int, int], None] | None = None,
    *,
    environments: int = ENVIRONMENTS,
    arrivals: bool = False,
    followers: Mapping[str, Any] | None = None,
    **settings: Any,
) -> list[Moment]:
    """Plays an evaluation and returns its moments, episode by episode; drops and ends always have one.

    Args:
        agent: what ``tactile_kit.load_agent`` returns.
        condition: written into every line.
        moments: s, at which lines are taken.
        progress: called with (episodes done, episodes in all).
        environments: how many play at a time.
        arrivals: whether the start and the first step within 0.4 rad of the goal have lines too.
        followers: estimators (``EstimatorCell``, ``KalmanFilter``, ``Rest``) by name that follow the same episodes
            while the agent, an oracle, is told the truth. Their lines come after the agent's, one follower after the
            other, with the name as condition.
        settings: of :func:`tactile_kit.evaluation.schedule.schedule`: objects, goals, seed, randomization, world.

    Raises:
        EvaluationError: followers of an agent that is not told the truth.
    """
    chorus = None if followers is None else Chorus(followers)
    acting = agent if chorus is None else chorus.beside(agent)
    plan = schedule(agent.task, **settings)
    symmetries = {thing.id: symmetry_of(thing) for thing in plan.variants.objects}
    found: dict[str, list[Moment]] = {name: [] for name in (condition, *(followers or ()))}
    for first in range(0, len(plan.specs), environments):
        specs = plan.specs[first : first + environments]
        episodes = plan.episodes[first : first + environments]
        things = [plan.variants.objects[plan.cases[episode.case].held] for episode in episodes]
        env = acting.make_env(
            plan.task,
            len(specs),
            settings.get("num_workers", 1),
            derive(0, "evaluation"),
            specs,
            plan.variants,
        )
        try:
            if chorus is not None:
                env.coupling.told = True
            recorder = _Recorder(env, [symmetries[thing.id] for thing in things], condition, chorus)
            lines = _lines(acting, env, recorder, moments, arrivals)
        finally:
            env.close()
        for name, courses in lines.items():
            for thing, episode, course in zip(things, episodes, courses, strict=True):
                found[name] += [
                    Moment(name, thing.id, thing.name, episode.goal, episode.seed, **line) for line in course
                ]
        if progress is not None:
            progress(first + len(specs), len(plan.specs))
    return [line for lines in found.values() for line in lines]


class _Recorder:
    """What there is to write down of E environments, one episode each, after a step: by condition and column."""

    def __init__(
        self, env: Any, symmetries: Sequence[Symmetry], condition: str, chorus: Chorus | None
    ) -> None:
        self.env, self.symmetries, self.condition, self.chorus = env, symmetries, condition, chorus
        self.total: dict[str, Any] = {}

    def after(self, step: int) -> dict[str, dict[str, Any]]:
        """Columns ``(E,)`` after that step; 0: at the start."""
        last: Any = self.env.transition if step else self.env.state
        found = {}
        for name, told in self._beliefs(last, step).items():
            R = np.asarray(told.R, np.float64)
            error = geodesic(R, last.R)
            self.total[name] = self.total.get(name, 0.0) + error
            sigma = getattr(told, "sigma", None)
            found[name] = {
                "theta": geodesic(last.R, last.goal),
                "believed": geodesic(R, last.goal),
                "error": error,
                "mean_error": self.total[name] / max(1, step),
                "position": np.linalg.norm(told.x - last.x, axis=1),
                "sigma": np.zeros(len(R)) if sigma is None else sigma[:, 1],
                "symmetric": np.array(
                    [
                        symmetry.error(mine, true)
                        for symmetry, mine, true in zip(self.symmetries, R, last.R, strict=True)
                    ]
                ),
            }
        return found

    def _beliefs(self, last: Any, step: int) -> dict[str, Any]:
        env, chorus = self.env, self.chorus
        if chorus is not None:
            beliefs = chorus.beliefs if step else chorus.believed(env.coupling.state)
            return {self.condition: last, **beliefs}
        return {self.condition: getattr(env, "estimated", last) if step else env.belief}


def _lines(
    agent: Any, env: Any, recorder: _Recorder, moments: Sequence[float], arrivals: bool
) -> dict[str, list[list[dict[str, Any]]]]:
    """By condition one episode an environment: its lines without what names it."""
    steps = {round(moment * CONTROL_RATE) for moment in moments}
    lines: dict[str, list[list[dict[str, Any]]]] = {}
    playing, away = np.ones(env.num_envs, bool), np.full(env.num_envs, arrivals)
    observation = env.reset()
    if arrivals:
        for name, values in recorder.after(0).items():
            lines[name] = [[_line(values, e, 0)] for e in range(env.num_envs)]
            away &= values["theta"] >= SUCCESS_ANGLE
    for step in range(1, HORIZON + 1):
        observation, _, done, infos = env.step(agent.act(observation))
        for name, values in recorder.after(step).items():
            mine = lines.setdefault(name, [[] for _ in range(env.num_envs)])
            arrived = away & (values["theta"] < SUCCESS_ANGLE)
            for e in np.flatnonzero(playing & (done | arrived | (step in steps))).tolist():
                end = ""
                if done[e]:
                    end = "fault" if infos[e]["fault"] else "drop" if infos[e]["drop"] else "time"
                mine[e].append(_line(values, e, step, end))
        away &= ~arrived
        playing &= ~done
        if not playing.any():
            break
    return lines


def _line(values: dict[str, Any], e: int, step: int, end: str = "") -> dict[str, Any]:
    line = {column: float(value[e]) for column, value in values.items()}
    return {"time": step / CONTROL_RATE, "end": end, **line}
