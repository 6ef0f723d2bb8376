"""The command ``reproduce``: the paper's results, and what they are made of, step by step.

Everything heavy is imported by the sub-command that needs it.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional, arg
from tyro.extras import SubcommandApp

from reproduce.ending import status_of
from reproduce.errors import ReproduceError
from reproduce.measuring import (
    Json,
    evaluate_planner,
    film_failures,
    measure_courses,
    measure_estimator,
    measure_sensitivity,
    measure_side_by_side,
    train_estimator,
)
from reproduce.output import counted, dumps, say, tell

Scale = Annotated[str, arg(metavar="smoke|small|paper|FILE")]
Source = Annotated[Literal["pretrained", "scratch"], arg(name="from")]
DirectoryOrNone = Annotated[Path | None, arg(metavar="DIR")]


def _plan(scale: str, source: str, out: Path | None, agents: Path | None):
    from reproduce.plan import default_out, make_plan
    from reproduce.scales import load_scale

    loaded = load_scale(scale)
    return make_plan(loaded, source, default_out(loaded.name, source) if out is None else out, agents)


def run(
    scale: Scale = "small",
    source: Source = "pretrained",
    jobs: Annotated[int, arg(metavar="N")] = 2,
    profile: Annotated[str | None, arg(metavar="slurm|DIR")] = None,
    out: DirectoryOrNone = None,
    agents: DirectoryOrNone = None,
) -> int:
    """Make every table, every figure and the report; what is up to date is left alone.

    A killed run goes on where it was when the same command is given again.

    Args:
        scale: How much: smoke (minutes), small (the shipped agents), paper (the paper's sizes), or a YAML file.
        source: pretrained takes the agents as they are and trains nothing; scratch trains them first.
        jobs: Jobs at a time.
        profile: Runs the jobs on a cluster: a profile that comes along, by name, or the folder of a Snakemake profile.
        out: Where results go. Default: results/ for small, results/<scale>/ for others, results/scratch/ for small from
            scratch.
        agents: Folder of agent directories. Default: results/agents, or <out>/agents from scratch.
    """
    from reproduce.pipeline import run as run_pipeline

    if jobs < 1:
        raise ReproduceError(f"--jobs {jobs}; allowed are integers >= 1")
    return run_pipeline(_plan(scale, source, out, agents), jobs, profile)


def stage(
    name: Positional[str],
    item: Positional[str] = "",
    scale: Scale = "small",
    source: Source = "pretrained",
    out: DirectoryOrNone = None,
    agents: DirectoryOrNone = None,
    pipeline: DirectoryOrNone = None,
) -> int:
    """Run one stage by hand: objects, grasps, train, evaluate, or a table, figure, claims, report.

    Args:
        name: Stage: objects, grasps, train, evaluate, table1, table2, estimators, object_sets, learning, violin,
            success, transfer, sensitivity, following, turning, failures, complex, extent, confusion, film, claims,
            report.
        item: Which job of the stage, for example oracle-vec_bps-geometric8-s0/nominal; all of them by default.
        scale: As in run.
        source: As in run.
        out: As in run.
        agents: As in run.
        pipeline: Folder of job files as they are (the workflow's own calls); scale, from, out and agents are not read.
    """
    from reproduce.stages import items_of, run_stage

    folder = pipeline
    if folder is None:
        from reproduce.prepare import prepare

        plan = _plan(scale, source, out, agents)
        prepare(plan)
        folder = plan.pipeline
    for one in [item] if item else items_of(folder, name):
        run_stage(folder, name, one, echo=pipeline is None)
    return 0


def train(
    config: Positional[Path],
    out: Annotated[Path, arg(metavar="DIR")],
    workers: Literal["processes", "ray"] | None = None,
    num_workers: Annotated[int | None, arg(metavar="N")] = None,
) -> int:
    """Train one agent as a run configuration (YAML) says, or go on with a run that was stopped.

    Ctrl-C or SIGTERM ends it after the roll-out in progress, with a checkpoint; a second one ends it at once.

    Args:
        config: The run's settings; the config.yaml of any run directory will do.
        out: The run directory. With the same configuration a stopped run is continued.
        workers: What simulates, instead of what the configuration says: processes, or ray: actors on all machines of
            a Ray cluster, which the extra ray installs. The results are the same.
        num_workers: How many of them, instead of what the configuration says.
    """
    from tactile_kit.runs.config import RunConfig

    changes = {"workers": workers, "num_workers": num_workers}
    settings = RunConfig.from_yaml(
        config, {name: value for name, value in changes.items() if value is not None}
    )
    say(f"{out.name}: {settings.steps:,} steps as {config} says; loads what it needs")
    from reproduce.stages.train import train_config
    from reproduce.summary import summary

    train_config(settings, out)
    print(summary(out))
    return 0


def evaluate(
    agent: Annotated[Path, arg(metavar="DIR")],
    out: Annotated[Path, arg(metavar="FILE")],
    objects: Annotated[str, arg(metavar="NAME[,NAME]")] = "paper",
    episodes_per_goal: Annotated[int, arg(metavar="K")] = 1,
    seed: Annotated[int, arg(metavar="S")] = 0,
    given: str = "true",
    scaling: Literal["nominal", "random"] = "nominal",
    sizes: int = 1,
    estimator: Annotated[str, arg(metavar="NAME|DIR")] = "own",
    world: Annotated[str, arg(metavar="bullet|mujoco")] = "bullet",
    num_envs: int = 16,
    num_workers: int = 1,
    json: Json = False,
) -> int:
    """Evaluate an agent on the 24 octahedral goals; one row an episode goes to FILE (CSV).

    A small table goes to the terminal. For programs the last line on stdout is one JSON object with success_rate and
    episodes: with --json, and wherever stdout is no terminal.

    Args:
        agent: The agent's directory.
        out: The episode file to write.
        objects: Object sets, names or ids, paths of sets, or one object of a set (my_set/mug), separated by commas.
        episodes_per_goal: Repeats of each of the 24 goals on each object.
        seed: Of the evaluation; its streams are apart from training's.
        given: The mesh the agent is told of: true, nominal, each, or an object's name.
        scaling: Nominal sizes, or random extents.
        sizes: Random sizes an object.
        estimator: What tells the agent of the pose: own, kalman, rest, or a tactile agent whose cell does.
        world: The physics: bullet, or mujoco, which the extra transfer installs.
        num_envs: Environments stepped together.
        num_workers: Processes that simulate.
        json: No table, the JSON object alone.
    """
    from reproduce.files import require_agent
    from reproduce.stages.evaluate import evaluate_to

    say(f"evaluate: loads {require_agent(agent)}, prepares {objects}")
    with counted("evaluate", "episodes") as progress:
        summary = evaluate_to(
            agent, out, objects=objects, episodes_per_goal=episodes_per_goal, seed=seed, given=given, scaling=scaling,
            sizes=sizes, estimator=estimator, world=world, num_envs=num_envs, num_workers=num_workers,
            progress=progress,
        )  # fmt: skip
    tell(summary, json)
    return 0


def film(
    agent: Annotated[Path, arg(metavar="DIR")],
    out: Annotated[Path, arg(metavar="FILE")],
    objects: Annotated[str, arg(metavar="NAME[,NAME]")] = "l_shape",
    episodes: int = 1,
    columns: int = 1,
    seed: int = 0,
    size: int = 320,
) -> int:
    """Film an agent turning objects; the goal stands beside, a wire frame is what the agent believes.

    Args:
        agent: The agent's directory.
        out: The film to write, .gif or .mp4.
        objects: Object sets, names or ids, separated by commas; episodes take them in turn.
        episodes: How many episodes.
        columns: How many play side by side; the others follow.
        seed: Of grasps, goals and physics.
        size: Edge of a panel in pixels, a multiple of 16.
    """
    from object_sets.storage import check_file_writable
    from reproduce.files import require_agent

    check_file_writable(out, "--out")
    say(f"film: loads {require_agent(agent)}, prepares {objects}")
    from tactile_kit.view.film import film as write_film

    clips = write_film(agent, out, objects=objects, episodes=episodes, columns=columns, seed=seed, size=size)
    for clip in clips:
        print(f"{clip.held.name}: {clip.verdict()}")
    print(f"{out}: {len(clips)} episodes, {out.stat().st_size / 1e6:.1f} MB")
    return 0


def view(
    agent: Annotated[Path, arg(metavar="DIR")],
    objects: Annotated[str, arg(metavar="NAME")] = "l_shape",
    given: str = "true",
    extents: Annotated[str, arg(metavar="X,Y,Z")] = "",
    goal: Annotated[int, arg(metavar="0..23")] = 1,
    randomization: Annotated[str, arg(metavar="PRESET")] = "default",
    terms: Annotated[str, arg(metavar="NAME=VALUE[,...]")] = "",
    seed: Annotated[int, arg(metavar="S")] = 0,
    record: Annotated[Path | None, arg(metavar="FILE")] = None,
    host: str = "127.0.0.1",
    port: int = 8080,
) -> int:
    """Look at an agent at work in the browser, or write a replay that opens from disk.

    The page has everything else: run, pause, step, speed, going back, other objects, goals and agents, pushes.

    Args:
        agent: The agent's directory.
        objects: The object held: a name, or one object of a set (my_set/mug).
        given: The mesh the agent is told of: true, or an object's name.
        extents: Of the object held, cm; nominal by default.
        goal: Which of the 24 octahedral goals.
        randomization: Preset or YAML file of domain randomisation.
        terms: Single terms of it from another preset or as a number, such as force=none,tip_friction=0.5.
        seed: Of grasp, physics and noise.
        record: Serve no page but write a replay, .html (a page of its own) or .viser.
        host: Address to listen on; the default is reached from this machine only.
        port: Port to listen on; 0 takes any that is free.
    """
    import reproduce.view

    choice = reproduce.view.choice_of(objects, given, extents, goal, randomization, terms, seed)
    if record is not None:
        reproduce.view.record(agent, choice, record)
    else:
        reproduce.view.view(agent, choice, host, port)
    return 0


def status(
    scale: Scale = "small",
    source: Source = "pretrained",
    out: DirectoryOrNone = None,
    agents: DirectoryOrNone = None,
    json: Json = False,
) -> int:
    """Show the runs of a scale: how far each is, its curve, its hours; what which table lacks, and how long that takes.

    Args:
        scale: As in run.
        source: As in run.
        out: As in run.
        agents: As in run.
        json: The same as one JSON object.
    """
    from reproduce.status import standing, text

    found = standing(_plan(scale, source, out, agents))
    print(dumps(found) if json else text(found))
    return 0


COMMANDS = (
    run, stage, status, train, evaluate, film, view, train_estimator, measure_estimator,
    measure_courses, measure_side_by_side, film_failures, measure_sensitivity, evaluate_planner,
)  # fmt: skip


def main(args: list[str] | None = None) -> int:
    """Entry point; returns the exit status. Errors of the project end with one line, not with a traceback."""
    return status_of(lambda: _run(sys.argv[1:] if args is None else args))


def _run(args: list[str]) -> int:
    # tyro would answer `reproduce trian --help` with the help of `reproduce`
    names = [command.__name__.replace("_", "-") for command in COMMANDS]
    if args and not args[0].startswith("-") and args[0] not in names:
        from tactile_kit.errors import nearest

        raise ReproduceError(f"sub-command {args[0]!r} unknown{nearest(args[0], names)}")
    description = (__doc__ or "").splitlines()[0]
    app = SubcommandApp()
    for command in COMMANDS:
        app.command(command)
    return (
        app.cli(args=args, prog="reproduce", description=description, config=(tyro.conf.FlagCreatePairsOff,))
        or 0
    )
