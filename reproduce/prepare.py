"""A plan written down as small YAML files, one a job. Each file is an input of its job, so that a changed setting
re-runs exactly its dependants.
"""

from __future__ import annotations

import functools
import json
import operator
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from reproduce import resources
from reproduce.files import CODE, dump_yaml, read_json, shown, write_if_changed
from reproduce.inventory import NEEDS, found, inventory, is_made
from reproduce.plan import ARTEFACTS, Evaluation, Plan
from reproduce.settings import evaluation_grasps, evaluation_settings, run_settings, training_grasps

OBJECTS = {"paper": 13, "all": 16, "geometric8": 8, "ood": 5, "complex": 3}  # sizes of the named sets


def weight(evaluation: Evaluation) -> int:
    """Episodes of an evaluation (for progress and order; the exact number is known once objects are loaded)."""
    group = evaluation.group
    objects = sum(OBJECTS.get(part, 1) for part in group.objects.split(","))
    meshes = objects if group.given == "each" else 1
    return objects * meshes * group.sizes * group.goals_per_case * group.episodes_per_goal


def prepare(plan: Plan) -> Path:
    """Writes the job files below ``<out>/.pipeline`` (only those that changed); returns the workflow's config file."""
    jobs = plan.pipeline / "jobs"
    evaluations = [evaluation for evaluation in plan.evaluations if plan.possible(evaluation)]
    grasps: dict[str, Any] = {}
    train: dict[str, Any] = {}
    evaluate: dict[str, Any] = {}
    for job, runs in (plan.jobs() if plan.trains else {}).items():
        entries: list[dict[str, Any]] = [
            {"run": run.name, "directory": str(run.directory), "config": run_settings(plan, run)}
            for run in runs
        ]
        write_if_changed(jobs / "train" / f"{job}.yaml", dump_yaml(entries))
        banks = dict(training_grasps(entry["config"]) for entry in entries)
        grasps |= banks
        after = {plan.job_of(name) for run in runs for name in run.sources} - {job}
        steps = sum(int(entry["config"].get("steps", 0)) for entry in entries)
        train[job] = {
            "after": sorted(after),
            "grasps": sorted(banks),
            **_together(entry["config"] for entry in entries).as_dict,
            "priority": 50 + min(steps, 10**9) / 1e9 if not after else 40,  # what others wait for goes first
            "steps": steps,
        }
    for evaluation in evaluations:
        settings = evaluation_settings(plan, evaluation)
        write_if_changed(jobs / "evaluate" / f"{evaluation.name}.yaml", dump_yaml(settings))
        trained = (
            run_settings(plan, evaluation.run) if plan.trains else read_json(plan.manifest(evaluation.run))
        )
        bank, task = evaluation_grasps(plan, evaluation, trained["task"])
        grasps[bank] = task
        agent = (
            plan.pipeline / "trained" / f"{evaluation.run.job}.json"
            if plan.trains
            else plan.manifest(evaluation.run)
        )
        evaluate[evaluation.name] = {
            "agent": str(agent.relative_to(plan.pipeline)) if plan.trains else str(agent),
            "grasps": [bank],
            "episodes": weight(evaluation),
            **resources.evaluation(weight(evaluation), plan.scale.num_envs, plan.scale.num_workers).as_dict,
        }
    for item, settings in grasps.items():
        write_if_changed(jobs / "grasps" / f"{item}.yaml", dump_yaml(settings))
    write_if_changed(jobs / "objects.yaml", dump_yaml({"objects": "all"}))
    needs = {}
    for artefact in NEEDS:
        content = inventory(plan, artefact)
        write_if_changed(jobs / "artefacts" / f"{artefact}.yaml", dump_yaml(content))
        needs[artefact] = _needs(plan, content)
    content = {
        "out": str(plan.out),
        "pipeline": str(plan.pipeline),
        "source": str(CODE / "reproduce"),
        "num_workers": plan.scale.num_workers,
        "grasps": {
            item: resources.grasps(_sizes(task), plan.scale.num_workers).as_dict
            for item, task in sorted(grasps.items())
        },
        "train": train,
        "evaluate": evaluate,
        "needs": needs,
        "artefacts": {name: list(map(str, plan.outputs(name))) for name in ARTEFACTS},
    }
    config = plan.pipeline / "plan.json"
    write_if_changed(config, json.dumps(content, indent=1) + "\n")
    return config


def _together(configs: Iterable[dict[str, Any]]) -> resources.Need:
    """What the trainings of one job need, one after another."""
    return functools.reduce(operator.or_, map(resources.training, configs))


def _sizes(task: dict[str, Any]) -> int:
    objects = sum(OBJECTS.get(part, 1) for part in task["objects"].split(","))
    return objects * (1 + task["variants"] if task["scaling"] == "random" else 1)


def _needs(plan: Plan, content: dict[str, Any]) -> dict[str, list[str]]:
    """What the workflow has to wait for before the artefact: episodes made here, files found, runs."""
    made = [name for name, file in content["episodes"].items() if file and is_made(name)]
    runs = set()
    for name, run in content["runs"].items():
        files = [run["agent"], run["metrics"]]
        if plan.trains:
            runs |= {f"trained/{plan.job_of(name)}.json"} if any(files) else set()
        else:
            runs |= {file for file in files if file}
    return {"episodes": made, "found": found(content), "runs": sorted(runs)}


def describe(plan: Plan) -> str:
    """One line for the terminal."""
    there = sum(plan.available(run) for run in plan.runs)
    agents = f"{len(plan.runs)} runs to train" if plan.trains else f"{there} of {len(plan.runs)} agents there"
    episodes = sum(weight(e) for e in plan.evaluations if plan.possible(e))
    where = f"scale {plan.scale.name} from {plan.source}"
    return f"{where}: {agents}, {episodes} evaluation episodes, into {shown(plan.out)}"
