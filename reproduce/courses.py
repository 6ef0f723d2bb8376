"""Files of courses: how agents' episodes go, and estimators side by side: following an oracle, telling its policy."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from reproduce.errors import ReproduceError
from reproduce.files import read_json, require_agent, write_atomic

OWN, TRUTH = "own", "truth"  # conditions: as the agent was trained; the oracle that is followed
FOLLOWING, TELLING = "following", "telling"
BESIDE = ("kalman", "rest")  # of evaluation.estimators, what learns nothing
TOGETHER = 52  # environments at a time
COST_OBJECTS, COST_GOALS = (
    "cube,cylinder,l_shape",
    4,
)  # one of each of Table I's classes, for what a step costs alone


def condition(estimator: str, mode: str) -> str:
    """What lines of an estimator are called in files."""
    return f"{estimator}, {mode}"


def courses_to(
    agent: Path, out: Path, progress: Callable[[int, int], None] | None = None, **settings: Any
) -> int:
    """Plays an evaluation of the agent and writes its courses (CSV); returns its episodes.

    Args:
        agent: the agent's directory. settings: of ``evaluation.schedule.schedule``.

    Raises ``ReproduceError`` where there is no agent.
    """
    require_agent(agent)
    import torch

    from tactile_kit.agents.agent import load_agent
    from tactile_kit.evaluation.courses import write_courses
    from tactile_kit.evaluation.playing import play

    torch.set_num_threads(1)
    lines = play(load_agent(agent), OWN, progress=progress, arrivals=True, quiet=True, **settings)
    write_courses(out, lines)
    return sum(bool(line.end) for line in lines)


def side_by_side_to(
    agent: Path,
    cells: Sequence[Path],
    out: Path,
    progress: Callable[[str, int, int], None] | None = None,
    **settings: Any,
) -> int:
    """Plays what ``out`` does not hold yet and writes it after each condition; returns its episodes.

    Args:
        agent: directory of the oracle. cells: directories of tactile agents; their names are those of the estimators.
        out: file of courses (CSV). In the JSON beside it: what a step of each estimator costs, and digests of the
            agents' weights, so that no file goes on with other agents of the same names.
        settings: of ``evaluation.schedule.schedule``.

    Raises:
        ReproduceError: no agent in a directory, or ``out`` holds other episodes or agents than those asked for. An
            oracle among the cells raises ``EvaluationError``.
    """
    for directory in (agent, *cells):
        require_agent(directory)
    import torch

    from tactile_kit.agents.agent import load_agent
    from tactile_kit.evaluation.chorus import Timed
    from tactile_kit.evaluation.courses import Moment, read_courses, write_courses
    from tactile_kit.evaluation.estimators import told
    from tactile_kit.evaluation.playing import play

    torch.set_num_threads(1)
    oracle = load_agent(agent)
    sources = {directory.name: str(directory) for directory in cells} | {name: name for name in BESIDE}
    estimators = {name: told(oracle, source).estimator for name, source in sources.items()}
    weights = {directory.name: load_agent(directory).manifest.weights for directory in (agent, *cells)}
    beside = out.with_suffix(".json")
    lines = read_courses(out) if out.is_file() else []
    if lines and (not beside.is_file() or read_json(beside)["agents"] != weights):
        raise ReproduceError(
            f"{out}: made with other agents than {', '.join(weights)} as they are now; delete it"
        )
    there = {line.condition for line in lines}

    def report(name: str) -> Any:
        return None if progress is None else lambda done, total: progress(name, done, total)

    def keep(new: list[Moment]) -> None:
        lines.extend(new)
        _require_same(out, lines)
        write_courses(out, lines)

    if TRUTH not in there:
        write_atomic(beside, json.dumps({"agents": weights, "costs": {}}, indent=1) + "\n")
        followers = {condition(name, FOLLOWING): Timed(one) for name, one in estimators.items()}
        keep(
            play(
                oracle, TRUTH, progress=report(FOLLOWING), environments=TOGETHER, arrivals=True,
                followers=followers, quiet=True, **settings,
            )
        )  # fmt: skip
        alone = {name: Timed(one) for name, one in estimators.items()}
        few = settings | {"objects": COST_OBJECTS, "goals_per_case": COST_GOALS}
        play(oracle, TRUTH, (), environments=1, followers=alone, quiet=True, **few)
        together = {name: followers[condition(name, FOLLOWING)] for name in estimators}
        costs = {name: {"alone": alone[name].cost(), "together": together[name].cost()} for name in alone}
        write_atomic(beside, json.dumps({"agents": weights, "costs": costs}, indent=1) + "\n")
    for name, estimator in estimators.items():
        label = condition(name, TELLING)
        if label not in there:
            keep(
                play(
                    oracle.told_by(estimator),
                    label,
                    progress=report(label),
                    arrivals=True,
                    quiet=True,
                    **settings,
                )
            )
    return sum(bool(line.end) for line in lines)


def _require_same(out: Path, lines: Sequence[Any]) -> None:
    """Raises unless every condition has the same episodes."""
    seeds: dict[str, list[int]] = {}
    for line in lines:
        if line.end:
            seeds.setdefault(line.condition, []).append(line.seed)
    first = next(iter(seeds.values()))
    for name, mine in seeds.items():
        if mine != first:
            raise ReproduceError(
                f"{out}: {name} has other episodes than those asked for; name another file or delete it"
            )
