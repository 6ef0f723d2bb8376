"""What each artefact reads: runs, episodes, curves, and the files they are in (written by ``prepare``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from reproduce.plan import Plan

TRANSFER = "mujoco"  # the evaluation in another simulator
FAILED = "failures"  # the folder of films of failures; found, not made
PLANNER = "planner"  # its episodes are found, not made by the pipeline
SENSITIVITY = "sensitivity"  # courses under one term of the randomisation at a time; found, not made
SIDE_BY_SIDE = (
    "estimators"  # courses of an oracle's episodes with estimators beside it, and what they cost; likewise
)
COURSE = "courses"  # an agent's own; likewise
KALMAN = "kalman"  # the evaluation in which a filter stands in for the agent's own estimator

ORACLE, TACTILE = "oracle-vec_bps-geometric8", "tactile-vec_bps-geometric8"
FINGERS = "tactile-vec_bps_fingers-geometric8"
TRANSFERRED = (ORACLE, FINGERS, TACTILE)  # taken to the other simulator
BENCHMARK = (ORACLE, "oracle-pos-geometric8", TACTILE, "tactile-pos-geometric8")
ABLATED = {  # Table II's rows
    "no_sigma": "tactile-vec_bps_nosigma-geometric8",
    "stop_gradient": "tactile-vec_bps_stopgrad-geometric8",
    "no_shape": "tactile-none-geometric8",
    "distances_only": "tactile-bps-geometric8",
}

_NOMINAL = {
    "table1": [(role, "nominal") for role in BENCHMARK],
    "table2": [(role, "nominal") for role in (TACTILE, *ABLATED.values())],
    "violin": [(role, "nominal") for role in (ORACLE, TACTILE)],
    "success": [(TACTILE, "nominal"), (TACTILE, TRANSFER)],
    "transfer": [(role, world) for role in TRANSFERRED for world in ("nominal", TRANSFER)],
    "complex": [(role, "complex") for role in (ORACLE, TACTILE)],
    "extent": [(TACTILE, "extent-true"), (TACTILE, "extent-fixed")],
    "confusion": [(TACTILE, "confusion")],
}
# Table I's columns that the paper has not
_BESIDE = [(FINGERS, "nominal"), (TACTILE, KALMAN), (PLANNER, "nominal")]
_ALL = list(dict.fromkeys(pair for pairs in _NOMINAL.values() for pair in pairs))
# artefact -> (role, evaluation) pairs it reads; whether it reads the oracles' learning curves
NEEDS: dict[str, tuple[list[tuple[str, str]], bool]] = {
    **{name: (pairs, False) for name, pairs in _NOMINAL.items()},
    "table1": ([*_NOMINAL["table1"], *_BESIDE], False),
    "sensitivity": ([], False),
    "estimators": ([(TACTILE, "nominal"), (FINGERS, "nominal"), (TACTILE, KALMAN)], False),
    "following": ([(TACTILE, "nominal"), (FINGERS, "nominal")], False),
    "turning": ([], False),
    "failures": ([], False),
    "object_sets": ([], False),
    "film": ([(FINGERS, "nominal"), (TACTILE, "nominal")], False),
    "learning": ([], True),
    "claims": (_ALL, True),
    "report": ([*_ALL, *_BESIDE], True),
}
EVALUATED = tuple(dict.fromkeys((ORACLE, FINGERS, TACTILE, *BENCHMARK, *ABLATED.values())))
COURSES = {  # artefact -> roles and names of the courses it reads
    "sensitivity": [(FINGERS, SENSITIVITY)],
    "estimators": [(ORACLE, SIDE_BY_SIDE)],
    "following": [(ORACLE, SIDE_BY_SIDE)],
    "turning": [(role, COURSE) for role in TRANSFERRED],
    "failures": [(role, COURSE) for role in EVALUATED],
}


def inventory(plan: Plan, artefact: str) -> dict[str, Any]:
    """The files ``artefact`` reads, as plain data: paths, and None where a file isn't there and won't be made."""
    pairs, curves = NEEDS[artefact]
    roles = {role for role, _ in pairs}
    courses: dict[str, str] = {}
    costs: dict[str, str] = {}
    for role, name in COURSES.get(artefact, ()):
        roles.add(role)
        for run in plan.runs:
            file = plan.out / "episodes" / run.name / f"{name}.csv"
            if run.role == role and file.is_file():
                courses[f"{run.name}/{name}"] = str(file)
                if file.with_suffix(".json").is_file():
                    costs[f"{run.name}/{name}"] = str(file.with_suffix(".json"))
    films = failure_films(plan.out) if artefact == "report" else []
    lines = {run.name for run in plan.runs if curves and run.kind == "oracle" and run.curves}
    episodes: dict[str, str | None] = {}
    for evaluation in plan.evaluations:
        if (evaluation.run.role, evaluation.group.name) in pairs:
            episodes[evaluation.name] = str(evaluation.file) if plan.possible(evaluation) else None
    planned = plan.out / "episodes" / PLANNER / "nominal.csv"
    cost = {}
    if (PLANNER, "nominal") in pairs and planned.is_file():
        episodes[f"{PLANNER}/nominal"] = str(planned)
        if planned.with_suffix(".json").is_file():
            cost = {"cost": str(planned.with_suffix(".json"))}
    return {
        "artefact": artefact,
        "scale": plan.scale.name,
        "description": plan.scale.description,
        "source": plan.source,
        "seed": plan.scale.seed,
        "runs": {
            run.name: {
                "role": run.role,
                "agent": str(run.directory / "agent.json") if plan.available(run) else None,
                "metrics": str(run.directory / "metrics.jsonl")
                if run.name in lines and plan.has_curve(run)
                else None,
            }
            for run in plan.runs
            if run.role in roles or run.name in lines
        },
        "episodes": episodes,
        "courses": courses,
        "costs": costs,
        "films": list(map(str, films)),
        **cost,
    }


def found(content: dict[str, Any]) -> list[str]:
    """The files of an inventory that are there already, whatever the pipeline makes."""
    files = [file for name, file in content["episodes"].items() if file and not is_made(name)]
    files += [*content["courses"].values(), *content["costs"].values(), *content["films"]]
    return files + ([content["cost"]] if "cost" in content else [])


def failure_films(out: Path) -> list[Path]:
    """Films of failures and the table of what is in them (``reproduce.failing``), where somebody made them."""
    table = out / "report" / FAILED / "failures.csv"
    return [table, *sorted(table.parent.glob("*.mp4"))] if table.is_file() else []


def is_made(episodes: str) -> bool:
    """Whether the pipeline makes the episode file ``RUN/EVALUATION``."""
    return not episodes.startswith(f"{PLANNER}/")
