"""A scale as data: which runs to train and how, and how much to evaluate. ``reproduce/scales/<name>.yaml``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    Field,
    NonNegativeInt,
    PositiveInt,
    ValidationError,
)

from reproduce.errors import ScaleError
from reproduce.files import read_yaml
from tactile_kit.errors import nearest
from tactile_kit.settings import Settings, explain
from tactile_kit.simulation.engines import WORLDS

FOLDER = Path(__file__).parent / "scales"

SETS: dict[str, dict[str, str]] = {  # what an object set of a run name means (paper, Fig. 4)
    "cube": {"objects": "cube", "scaling": "nominal"},
    "cuboids": {"objects": "cube", "scaling": "random"},
    "geometric8": {"objects": "geometric8", "scaling": "random"},
}
VARIATIONS: dict[str, dict[str, Any]] = {  # settings of runs whose variant ends so
    # Table II: no sigma input to the policy; no gradient through the BPS
    "nosigma": {"task.sigma_in_observation": False},
    "stopgrad": {"estimator.stop_gradient": True},
    # beside the paper: the cell that looks from the fingers, and its loss
    "fingers": {"estimator.cell": "fingers", "estimator.loss": "pose"},
}


def _variant(name: str) -> str:
    from tactile_kit.shape import names

    if split_variant(name)[0] not in names():
        varied = [f"{encoding}_{variation}" for encoding in names() for variation in VARIATIONS]
        raise ValueError(f"unknown{nearest(name, [*names(), *varied])}")
    return name


def _set(name: str) -> str:
    if name not in SETS:
        raise ValueError(f"unknown{nearest(name, SETS)}")
    return name


def _world(name: str) -> str:
    if name not in WORLDS:
        raise ValueError(f"unknown{nearest(name, WORLDS)}")
    return name


Variant = Annotated[str, AfterValidator(_variant)]
SetName = Annotated[str, AfterValidator(_set)]


def split_variant(variant: str) -> tuple[str, str]:
    """``vec_bps_nosigma`` -> (``vec_bps``, ``nosigma``); the variation is empty where there is none."""
    variation = next((name for name in VARIATIONS if variant.endswith(f"_{name}")), "")
    return (variant.removesuffix(f"_{variation}") if variation else variant), variation


class RunGroup(Settings):
    """A grid of runs that share a preset. A run's name is ``<kind>-<variant>-<set>-s<seed>``."""

    kind: Literal["oracle", "tactile"]
    variants: tuple[Variant, ...] = Field(min_length=1)
    sets: tuple[SetName, ...] = Field(min_length=1)
    seeds: tuple[NonNegativeInt, ...] = Field((0,), min_length=1)
    preset: str = Field(description="Key in `presets`.")
    warm_start: str | None = Field(
        None, description="Run to start from; {encoding}, {set} and {seed} are filled in."
    )
    teacher: str | None = Field(None, description="Oracle run that teaches these (PPO), likewise.")
    curves: bool = Field(True, description="Whether its oracle runs belong to the learning curves of Fig. 5.")
    together: bool = Field(False, description="Train all runs of the group one after another in one process.")


class EvaluationGroup(Settings):
    """One evaluation of several runs, at the sizes of this scale."""

    name: Literal["nominal", "complex", "extent-true", "extent-fixed", "confusion", "kalman", "mujoco"]
    runs: tuple[str, ...] = Field(min_length=1, description="Run names without the seed.")
    seeds: tuple[NonNegativeInt, ...] | None = Field(
        None, description="Which of their seeds; all by default."
    )
    objects: str
    scaling: Literal["nominal", "random"] = "nominal"
    sizes: PositiveInt = Field(
        1, description="Prepared sizes an object; the paper's environments where random."
    )
    given: Literal["true", "nominal", "each"] = Field("true", description="The mesh the agent is told of.")
    estimator: Literal["own", "kalman"] = Field("own", description="What tells the agent of the pose.")
    world: Annotated[str, AfterValidator(_world)] = Field(
        "bullet", description="The physics it is played in."
    )
    episodes_per_goal: PositiveInt = 1
    goals_per_case: int = Field(
        24, ge=1, le=24, description="Goals of the 24 drawn for each object, size and mesh."
    )


class Scale(Settings):
    """One scale of the whole pipeline."""

    name: str
    description: str
    seed: NonNegativeInt = 0
    num_envs: PositiveInt = Field(16, description="Environments stepped together in an evaluation.")
    num_workers: PositiveInt = 1
    presets: dict[str, dict[str, Any]] = Field(description="Run settings by name; see `RunConfig`.")
    runs: tuple[RunGroup, ...]
    evaluations: tuple[EvaluationGroup, ...]


def load_scale(name_or_path: str) -> Scale:
    """The scale of that name (``smoke``, ``small``, ``paper``) or of that YAML file.

    Raises ``ScaleError`` naming file, key, value and what is allowed.
    """
    path = Path(name_or_path)
    if path.suffix not in (".yaml", ".yml"):
        known = sorted(file.stem for file in FOLDER.glob("*.yaml"))
        if name_or_path not in known:
            raise ScaleError(f"scale {name_or_path!r} unknown{nearest(name_or_path, known)}")
        path = FOLDER / f"{name_or_path}.yaml"
    return parse_scale(read_yaml(path), str(path))


def parse_scale(content: Any, source: str) -> Scale:
    """A scale from parsed YAML; ``source`` is the file named in errors."""
    if not isinstance(content, dict):
        raise ScaleError(
            f"{source}: {type(content).__name__}; allowed is a mapping with {', '.join(Scale.model_fields)}"
        )
    try:
        scale = Scale.model_validate(content)
    except ValidationError as error:
        raise ScaleError(f"{source}: {explain(error)}") from None
    for group in scale.runs:
        if group.preset not in scale.presets:
            raise ScaleError(
                f"{source}: runs: preset {group.preset!r} unknown{nearest(group.preset, scale.presets)}"
            )
    return scale
