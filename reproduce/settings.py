"""From a plan to the settings of its jobs: run configurations, evaluations, grasp banks. Plain data, fully resolved."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

from reproduce.errors import ScaleError
from reproduce.plan import Evaluation, Plan, Run
from reproduce.scales import SETS, VARIATIONS, split_variant

if TYPE_CHECKING:
    from tactile_kit.task.config import TaskConfig


def run_settings(plan: Plan, run: Run) -> dict[str, Any]:
    """The resolved ``RunConfig`` of a run: its preset of the scale, then what its name says.

    Raises ``ScaleError`` naming scale, run and the setting that doesn't fit.
    """
    from tactile_kit.runs.config import RunConfig

    encoding, variation = split_variant(run.variant)
    changes: dict[str, Any] = {
        "kind": run.kind,
        "seed": run.seed,
        "encoding": encoding,
        **SETS[run.set],
        **VARIATIONS.get(variation, {}),
    }
    if run.warm_start is not None:
        changes["warm_start"] = str(run.directory.parent / run.warm_start)
    if run.teacher is not None:
        changes["ppo.teacher"] = str(run.directory.parent / run.teacher)
    try:
        return RunConfig.build(plan.scale.presets[run.preset], changes, run.name).to_dict()
    except ValueError as error:
        raise ScaleError(f"scale {plan.scale.name}, preset {run.preset}: {error}") from None


def evaluation_settings(plan: Plan, evaluation: Evaluation) -> dict[str, Any]:
    """What ``tactile_kit.evaluate`` is called with, and where the rows go."""
    group = evaluation.group
    return {
        "agent": str(evaluation.run.directory),
        "out": str(evaluation.file),
        "objects": group.objects,
        "scaling": group.scaling,
        "sizes": group.sizes,
        "given": group.given,
        "estimator": group.estimator,
        "world": group.world,
        "episodes_per_goal": group.episodes_per_goal,
        "goals_per_case": group.goals_per_case,
        "seed": plan.scale.seed,
        "num_envs": plan.scale.num_envs,
        "num_workers": plan.scale.num_workers,
    }


def evaluation_grasps(
    plan: Plan, evaluation: Evaluation, trained: dict[str, Any]
) -> tuple[str, dict[str, Any]]:
    """As ``grasp_item``, for an evaluation of an agent trained under the task settings ``trained``."""
    from tactile_kit.evaluation.schedule import evaluation_task
    from tactile_kit.task.config import TaskConfig

    group = evaluation.group
    try:
        task = evaluation_task(
            TaskConfig(**trained),
            group.objects,
            plan.scale.seed,
            group.scaling,
            group.sizes,
            world=group.world,
        )
    except ValueError as error:
        raise ScaleError(f"{evaluation.name}: {error}") from None
    return grasp_item(task)


def training_grasps(config: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """As ``grasp_item``, for a training of the resolved ``config``."""
    from tactile_kit.runs.config import RunConfig

    return grasp_item(RunConfig.build(config).played)


def grasp_item(task: TaskConfig) -> tuple[str, dict[str, Any]]:
    """(name, task settings) of the grasps that a task needs. Runs with the same objects and physics share them."""
    keys = {
        "objects", "scaling", "variants", "variant_seed", "extent_range", "grasps", "grasp_spread", "simulation",
    }  # fmt: skip
    settings = task.model_dump(mode="json", include=keys)
    settings["simulation"] |= {"drag": 0.0}  # no matter of grasps
    digest = hashlib.blake2s(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:8]
    return f"{task.objects.replace(',', '+')}-{task.scaling}-{digest}", settings
