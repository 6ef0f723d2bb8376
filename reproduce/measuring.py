"""Sub-commands of ``reproduce`` that look at estimators, at what limits them, and at the planner beside them.

Everything heavy is imported by the sub-command that needs it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from reproduce.output import counted, dumps, say, tell

Json = Annotated[bool, arg(name="json")]


def train_estimator(
    agent: Annotated[Path, arg(metavar="DIR")],
    out: Annotated[Path, arg(metavar="DIR")],
    steps: Annotated[int, arg(metavar="N")] = 20_000_000,
    cell: Annotated[str, arg(metavar="NAME")] = "fingers",
    loss: Literal["pose", "likelihood"] = "pose",
    closed_loop: bool = False,
    seed: Annotated[int, arg(metavar="S")] = 0,
) -> int:
    """Train an estimator alone, on what a trained agent's policy does in the compiled physics.

    Data are made, not stored, without end; metrics.jsonl has the error as it falls. At the end, and with
    measure-estimator at any time, it is measured on episodes with sizes that training never saw.

    Args:
        agent: The agent whose policy acts: an oracle, or a tactile agent, whose estimator then goes on learning.
        out: The run directory. With the same arguments a stopped run is continued.
        steps: Environment steps.
        cell: What the recurrence looks at: fingers, or paper.
        loss: Plain distances of the pose, or the paper's likelihood.
        closed_loop: The policy is told the estimate, not the truth.
        seed: Of weights and episodes.
    """
    from reproduce.estimator import measure, settings_of, table
    from reproduce.files import require_agent
    from reproduce.stages.train import train_config

    say(f"{out.name}: reads {require_agent(agent)}, loads what it needs")
    train_config(settings_of(agent, steps, cell, loss, closed_loop, seed), out)
    print(table(measure(out, "geometric8", not closed_loop, 512, seed)))
    return 0


def measure_estimator(
    agent: Annotated[Path, arg(metavar="DIR")],
    objects: Annotated[str, arg(metavar="NAME[,NAME]")] = "geometric8",
    closed_loop: bool = False,
    estimator: Annotated[str, arg(metavar="NAME|DIR")] = "own",
    episodes: Annotated[int, arg(metavar="N")] = 512,
    seed: Annotated[int, arg(metavar="S")] = 0,
    each: bool = False,
    json: Json = False,
) -> int:
    """Measure a tactile agent's estimator: error of its angle (mean/median, rad) in time, by Table I's classes.

    In the compiled physics, in seconds. Shares of the estimates within 0.4 rad and beyond 1 rad at the end; error/sigma
    is 1 where sigma says how large the error is; success and drops are shares of the same episodes, believed is the
    mean angle to the goal that the agent believes in, reached the share that believes it below 0.4 rad. What is
    reported of an agent is measured by evaluate.

    Args:
        agent: The agent's directory.
        objects: Object sets, names or ids, separated by commas.
        closed_loop: The policy is told the estimate, as in every evaluation; otherwise the truth.
        estimator: Own, kalman, rest (the object never moves), or a tactile agent whose cell it is.
        episodes: How many, all at once.
        seed: Of the episodes.
        each: One row an object instead of a class.
        json: No table but one JSON list of its rows.
    """
    from reproduce.estimator import measure, table
    from reproduce.files import require_agent

    say(f"measure-estimator: loads {require_agent(agent)}, prepares {objects}")
    rows = measure(agent, objects, not closed_loop, episodes, seed, estimator, each)
    print(dumps(rows) if json else table(rows))
    return 0


def evaluate_planner(
    out: Annotated[Path, arg(metavar="FILE")],
    objects: Annotated[str, arg(metavar="NAME[,NAME]")] = "paper",
    episodes_per_goal: Annotated[int, arg(metavar="K")] = 1,
    goals_per_case: Annotated[int, arg(metavar="N")] = 24,
    seed: Annotated[int, arg(metavar="S")] = 0,
    randomization: Annotated[str, arg(metavar="PRESET")] = "default",
    planner: Annotated[Path | None, arg(metavar="YAML")] = None,
    num_workers: int = 0,
    json: Json = False,
) -> int:
    """Evaluate the planner, which needs no agent, on the same episodes; given again, a killed command goes on.

    Finished objects go to FILE (CSV), their cost in seconds of one core to the JSON beside it. Objects that are in FILE
    are not played again. A small table goes to the terminal. For programs the last line on stdout is one JSON object
    with success_rate, drops and cpu_seconds_per_action of the objects asked for: with --json, and wherever stdout is no
    terminal.

    Args:
        out: The episode file to write or to go on with; Table I reads results/episodes/planner/nominal.csv.
        objects: Object sets, names or ids, paths of sets, or one object of a set (my_set/mug), separated by commas.
        episodes_per_goal: Repeats of each goal on each object.
        goals_per_case: How many of the 24 goals.
        seed: Of the evaluation, as in evaluate.
        randomization: Preset or YAML file of domain randomisation; agents are evaluated under the default.
        planner: Settings of the planner (tactile_kit.planning.PlannerConfig); its defaults by default.
        num_workers: Processes that plan, an episode each; 0: this one.
        json: No table, the JSON object alone.
    """
    from object_sets.storage import check_file_writable
    from reproduce.planner import evaluate_to

    check_file_writable(out, "--out")
    with counted("evaluate-planner", "episodes") as progress:
        summary = evaluate_to(
            out, objects, planner=planner, episodes_per_goal=episodes_per_goal, goals_per_case=goals_per_case,
            seed=seed, randomization=randomization, num_workers=num_workers, progress=progress,
        )  # fmt: skip
    tell(summary, json)
    return 0


def measure_sensitivity(
    agent: Annotated[Path, arg(metavar="DIR")],
    out: Annotated[Path, arg(metavar="FILE")],
    only: Annotated[str, arg(metavar="NAME[,NAME]")] = "",
    objects: Annotated[str, arg(metavar="NAME[,NAME]")] = "paper",
    goals_per_case: Annotated[int, arg(metavar="N")] = 8,
    seed: Annotated[int, arg(metavar="S")] = 0,
    num_workers: int = 1,
) -> int:
    """Evaluate a tactile agent with one term of the randomisation at a time off, and twice as wide.

    All conditions play the same episodes in Bullet. Given again, a killed command goes on with the next condition.

    Args:
        agent: The agent's directory.
        out: The file to write or to go on with; the figure reads results/episodes/<agent>/sensitivity.csv.
        only: Conditions such as "joint offset x 0"; all by default.
        objects: Object sets, names or ids, separated by commas.
        goals_per_case: How many of the 24 goals each object is given.
        seed: Of the evaluation, as in evaluate.
        num_workers: Processes that simulate.
    """
    from object_sets.storage import check_file_writable
    from reproduce.sensitivity import measure_to

    def report(condition: str, done: int, total: int) -> None:
        say(f"{condition}: {done} of {total} episodes")

    check_file_writable(out, "--out")
    names = [name.strip() for name in only.split(",") if name.strip()]
    count = measure_to(
        agent, out, only=names, objects=objects, goals_per_case=goals_per_case, seed=seed, num_workers=num_workers,
        progress=report,
    )  # fmt: skip
    print(dumps({"episodes": count, "out": str(out)}))
    return 0


def measure_courses(
    agent: Annotated[Path, arg(metavar="DIR")],
    out: Annotated[Path, arg(metavar="FILE")],
    objects: Annotated[str, arg(metavar="NAME[,NAME]")] = "paper",
    goals_per_case: Annotated[int, arg(metavar="N")] = 24,
    seed: Annotated[int, arg(metavar="S")] = 0,
    num_workers: int = 1,
) -> int:
    """Write down how an agent's episodes go in Bullet, second by second: angles, errors, sigma, first arrival, end.

    Args:
        agent: The agent's directory.
        out: The file to write; the figures read results/episodes/<agent>/courses.csv.
        objects: Object sets, names or ids, separated by commas.
        goals_per_case: How many of the 24 goals each object is given.
        seed: Of the evaluation, as in evaluate.
        num_workers: Processes that simulate.
    """
    from object_sets.storage import check_file_writable
    from reproduce.courses import courses_to

    check_file_writable(out, "--out")
    with counted("measure-courses", "episodes") as progress:
        count = courses_to(
            agent, out, objects=objects, goals_per_case=goals_per_case, seed=seed, num_workers=num_workers,
            progress=progress,
        )  # fmt: skip
    print(dumps({"episodes": count, "out": str(out)}))
    return 0


def measure_side_by_side(
    agent: Annotated[Path, arg(metavar="DIR")],
    cells: Annotated[str, arg(metavar="DIR[,DIR]")],
    out: Annotated[Path, arg(metavar="FILE")],
    objects: Annotated[str, arg(metavar="NAME[,NAME]")] = "paper",
    goals_per_case: Annotated[int, arg(metavar="N")] = 24,
    seed: Annotated[int, arg(metavar="S")] = 0,
    num_workers: int = 1,
) -> int:
    """Set estimators side by side in Bullet: cells of tactile agents, the Kalman filter, and the object at rest.

    First all follow the same episodes of an oracle that is told the truth; then each tells the oracle's policy what it
    believes. What a step of each costs goes to the JSON beside FILE. Given again, a killed command goes on.

    Args:
        agent: The oracle whose policy acts.
        cells: Directories of the tactile agents whose cells are compared.
        out: The file to write or to go on with; the figure reads results/episodes/<agent>/estimators.csv.
        objects: Object sets, names or ids, separated by commas.
        goals_per_case: How many of the 24 goals each object is given.
        seed: Of the evaluation, as in evaluate.
        num_workers: Processes that simulate.
    """
    from object_sets.storage import check_file_writable
    from reproduce.courses import side_by_side_to

    def report(condition: str, done: int, total: int) -> None:
        say(f"{condition}: {done} of {total} episodes")

    check_file_writable(out, "--out")
    directories = [Path(name.strip()) for name in cells.split(",") if name.strip()]
    count = side_by_side_to(
        agent, directories, out, objects=objects, goals_per_case=goals_per_case, seed=seed, num_workers=num_workers,
        progress=report,
    )  # fmt: skip
    print(dumps({"episodes": count, "out": str(out)}))
    return 0


def film_failures(
    agent: Annotated[Path, arg(metavar="DIR")],
    courses: Annotated[Path, arg(metavar="FILE")],
    out: Annotated[Path, arg(metavar="DIR")],
    size: int = 192,
    seed: Annotated[int, arg(metavar="S")] = 0,
) -> int:
    """Film one failure of each kind: the first episode in the agent's courses that, played alone, fails so again.

    Args:
        agent: The agent's directory.
        courses: Its episodes, as measure-courses writes them.
        out: The folder to write to; the report shows results/report/failures.
        size: Edge of the picture in pixels, a multiple of 16.
        seed: Of the evaluation that the courses are of.
    """
    from reproduce.failing import films_to

    for row in films_to(agent, courses, out, size, seed):
        megabytes = (out / row["film"]).stat().st_size / 1e6
        print(f"{row['kind']}: {row['object']}, goal {row['goal']}: {row['verdict']} ({megabytes:.1f} MB)")
    return 0
