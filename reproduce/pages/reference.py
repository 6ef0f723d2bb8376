"""Observation, actions, reward, metrics, episode files and all settings of a training, read off the code.

What a name means stands here; that every name there is has a meaning, and no other, is checked when the page is made.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from reproduce.errors import ReproduceError
from reproduce.pages.markdown import table

HEAD = """# Observations, actions, reward, metrics, settings

<!-- Made from the code by `make docs`; edit the code, or reproduce/pages/reference.py, instead. -->

SI units and radians throughout, in the hand's frame; one step is 0.1 s.
"""
TERMS = {
    "joints": "the last six measurements at 60 Hz: 12 joint angles and 12 control errors (command less angle) each",
    "goal": "the rotation left to do, goal Rᵀ, first two columns",
    "shape": "the encoding of the mesh given, at the pose told",
    "pose": "the pose told: position, and first two columns of the rotation",
    "sigma": "tactile agents: how far off the estimator believes to be, in distances and in rotation",
}
ACTIONS = {
    "absolute": "target joint angles: -1 to 1 is the joint's range (the paper's)",
    "increment": "steps from the filtered command: 0 rests, 1 moves on by 0.15 rad in 0.1 s (the shipped agents')",
}
REWARD = {
    "rotation": "angle gained towards the goal, clipped from above",
    "position": "growing distance from where the object began",
    "posture": "fourth power of the joints' deviation from the mean grasp",
    "drop": "price of a drop or a fault (the paper has none)",
    "arrival": "coming within some 0.5 rad of the goal (the paper has none)",
}
METRICS = {
    "step": "environment steps, all environments together",
    "hours": "trained so far, held-out evaluations left out",
    "success": "share of the last episodes (500, or twice the environments) that ended within 0.4 rad, exploring",
    "theta": "their mean final angle, rad",
    "drops": "their share of drops",
    "faults": "their share of faults of the physics",
    "reward": "their mean return",
    "length": "their mean length, steps",
    "episodes": "finished since the start",
    "reward_*": "mean a step of each term of the reward",
    "steps_per_second": "since the line before",
    "gravity": "m/s², where a curriculum sets it",
    "rho": "share of the episodes in which the policy is told the true pose",
    "estimator/*": "means of the estimator's last training: loss, errors (shape and position m, angle rad), sigmas",
    "fed/*": "episodes in which the policy was told the estimate: its error, success, drops, what is believed",
    "policy_loss": "PPO's clipped objective",
    "value_loss": "squared error of the critic",
    "divergence": "mean KL divergence of an update, which steers the step size",
    "clipped": "share of samples whose ratio was clipped",
    "explained_variance": "of the returns, by the critic",
    "sigma": "mean standard deviation of the exploring policy",
    "value": "mean return that the update saw",
    "learning_rate": "of the actor",
    "updates": "gradient steps so far",
    "teacher_divergence": "from the teacher, while there is one",
}


def page() -> str:
    """The markdown."""
    return (
        "\n".join(
            [HEAD, _observations(), _actions(), _reward(), _metrics(), _episodes(), _settings()]
        ).rstrip()
        + "\n"
    )


def _observations() -> str:
    import object_sets
    from tactile_kit.shape import ENCODINGS, MeshTable
    from tactile_kit.task.observation import layout_of

    (cube,) = object_sets.select("cube")
    meshes = MeshTable.from_meshes([(cube.vertices, cube.faces)])
    rows: list[tuple[str, ...]] = []
    seen: set[str] = set()
    for name, kind in ENCODINGS.items():
        encoding = kind(meshes)
        for agent, sigma in (("oracle", False), ("tactile", True)):
            layout = layout_of(encoding, pose=True, sigma=sigma)
            seen |= set(layout)
            sizes = " + ".join(f"{size} {term}" for term, size in layout.sizes.items())
            rows.append((f"`{name}`", agent, sizes, str(layout.size)))
    _complete("observation terms", TERMS, seen)
    return (
        "## Observation\n\nTerms stand in this order, `float32`, in one flat vector:\n\n"
        + table(("term", "what"), [(f"`{name}`", text) for name, text in TERMS.items()])
        + "\n"
        + table(("encoding", "agent", "terms", "numbers"), rows)
    )


def _actions() -> str:
    from tactile_kit.hand.kinematics import JOINTS
    from tactile_kit.task.config import TaskConfig

    _complete("actions", ACTIONS, set(get_args(TaskConfig.model_fields["action"].annotation)))
    return (
        f"## Action\n\n{JOINTS} numbers in [-1, 1], ten times a second (`TaskConfig(action=...)`):\n\n"
        + table(("action", "meaning"), [(f"`{name}`", text) for name, text in ACTIONS.items()])
    )


def _reward() -> str:
    from tactile_kit.runs.config import TASK
    from tactile_kit.task.config import RewardConfig

    paper, ours = RewardConfig(), TASK.reward
    _complete("reward terms", REWARD, set(RewardConfig.model_fields) - {"rotation_clip"})
    rows = [
        (f"`{name}`", text, f"{getattr(paper, name):.4g}", f"{getattr(ours, name):.4g}")
        for name, text in REWARD.items()
    ]
    rows.append(
        (
            "`rotation_clip`",
            "most angle rewarded in a step, rad",
            str(paper.rotation_clip),
            str(ours.rotation_clip),
        )
    )
    return "## Reward\n\nThe sum of these terms, each logged:\n\n" + table(
        ("term", "what it weighs", "paper", "the shipped recipe"), rows
    )


def _metrics() -> str:
    rows = [(f"`{name}`", text) for name, text in METRICS.items()]
    return (
        "## Metrics of a training\n\nOne JSON object a line in `metrics.jsonl`, the same in TensorBoard. Held-out "
        "evaluations are lines of their own (`evaluation: true`) with `success_rate`, `episodes`, `drops`, `theta`.\n\n"
        + table(("key", "meaning"), rows)
    )


def unexplained(keys: set[str]) -> set[str]:
    """Keys of metrics.jsonl of which the page says nothing."""
    prefixes = tuple(name.removesuffix("*") for name in METRICS if name.endswith("*"))
    return {key for key in keys if key not in METRICS and not key.startswith(prefixes)}


def _episodes() -> str:
    from tactile_kit.evaluation.rows import EpisodeRow, allowed

    text = " ".join((EpisodeRow.__doc__ or "").split())
    return f"## Episode files\n\n{text}\n\n" + table(
        ("column", "holds"), [(f"`{name}`", holds) for name, holds in allowed().items()]
    )


def _settings() -> str:
    from tactile_kit.runs.config import RunConfig, presets

    rows = [(f"`{name}`", f"`{_short(default)}`", text) for name, default, text in _walk(RunConfig())]
    names = ", ".join(f"`{name}`" for name in presets())
    return (
        "## Settings of a training\n\nThe YAML file of `reproduce train` says what differs from these, or from the "
        f"preset that it names ({names}); nested keys are nested mappings.\n\n"
        + table(("setting", "default", "meaning"), rows)
    )


def _walk(settings: BaseModel, prefix: str = "") -> Iterator[tuple[str, Any, str]]:
    for name, field in type(settings).model_fields.items():
        value = getattr(settings, name)
        if isinstance(value, BaseModel):
            yield from _walk(value, f"{prefix}{name}.")
        else:
            assert field.default is not PydanticUndefined, name
            yield f"{prefix}{name}", value, field.description or ""


def _short(value: Any) -> str:
    """As YAML has it."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(_short, value))}]"
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _complete(what: str, said: Mapping[str, str], there: set[str]) -> None:
    if set(said) != there:
        raise ReproduceError(
            f"{Path(__file__).name}: {what}: explained are {sorted(said)}, there are {sorted(there)}"
        )
