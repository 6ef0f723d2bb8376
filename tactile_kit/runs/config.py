"""The settings of one training run: one frozen tree, filled by YAML presets and changes to single values."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, PositiveFloat, PositiveInt, ValidationError, model_validator

from randomization import GravitySchedule
from tactile_kit.agents.config import PPOConfig
from tactile_kit.ecrl.config import ECRLConfig
from tactile_kit.errors import ConfigError, nearest
from tactile_kit.estimator.config import EstimatorConfig
from tactile_kit.files import read_yaml
from tactile_kit.runs.calm import CalmConfig
from tactile_kit.settings import Settings, explain, merge, short
from tactile_kit.task.config import RewardConfig, TaskConfig

TASK = TaskConfig(  # to learn on; the class itself says what the paper does
    scaling="random",
    action="increment",
    reward=RewardConfig(drop=1.5, posture=0.1, rotation_clip=0.2, arrival=4.0),
)


class GravityConfig(Settings):
    """Gravity curriculum: a straight (or ``geometric``) line over ``steps`` environment steps, then constant.

    With ``drops`` below 1 it waits: only steps count during which at most that share of the last episodes was dropped,
    and while more than twice as many are, it goes back.
    """

    start: float = Field(0.1, gt=0, le=20, description="m/s^2 at step 0.")
    end: float = Field(9.81, gt=0, le=20, description="m/s^2 from ``steps`` on.")
    steps: int = Field(8_000_000, ge=0)
    drops: float = Field(0.22, gt=0, le=1, description="Share of drops up to which it goes on.")
    geometric: bool = Field(True, description="By equal factors instead of equal steps.")

    def after(self, counted: int, steps: int, drops: float | None) -> int:
        """Steps that count after ``steps`` more, ``drops`` being the share dropped of late; ``counted`` did before."""
        if drops is None or drops <= self.drops:
            return counted + steps
        return max(counted - steps, 0) if drops > 2.0 * self.drops else counted

    def at(self, step: int) -> float:
        """Gravity (m/s^2) after ``step`` steps that count, in a hundred stairs so that it changes rarely."""
        stair = max(self.steps // 100, 1)
        schedule = GravitySchedule(self.start, self.end, self.steps, self.geometric)
        return schedule.at(step - step % stair)


class EvaluationConfig(Settings):
    """Held-out evaluation while training: octahedral goals, evaluation seeds, full gravity."""

    minutes: float = Field(30.0, ge=0, description="Between evaluations; 0: none.")
    at_end: bool = Field(False, description="Evaluate the finished agent too.")
    steps: int = Field(
        0,
        ge=0,
        description="Every so many environment steps success without noise in the compiled physics, too; 0: never.",
    )
    episodes: PositiveInt = Field(512, description="Episodes behind each of these points.")
    objects: str | None = Field(None, description="Object set; None: the training objects.")
    episodes_per_goal: PositiveInt = 1
    num_envs: PositiveInt = 32


class CheckpointConfig(Settings):
    """When to save what."""

    minutes: PositiveFloat = Field(10.0, description="At most this long between checkpoints.")
    steps: int = Field(0, ge=0, description="Also every so many environment steps; 0: by time alone.")
    keep: PositiveInt = 2


class RunConfig(Settings):
    """Everything a training run depends on. The defaults are the recipe of the shipped oracles.

    ``encoding``, ``objects``, ``scaling`` and ``randomization`` may be given at the top level for short; they are the
    task's.
    """

    kind: Literal["oracle", "tactile"] = "oracle"
    seed: int = Field(0, ge=0)
    steps: PositiveInt = Field(100_000_000, description="Environment steps, summed over all environments.")
    num_envs: PositiveInt = 256
    num_workers: PositiveInt = 2
    workers: Literal["processes", "ray"] = Field(
        "processes",
        description="What simulates: processes (threads if compiled), or ray: actors on other machines.",
    )
    threads: PositiveInt = Field(2, description="Threads of the learner; part of what decides its rounding.")
    matmul_precision: Literal["highest", "high", "medium"] = "medium"
    start_at_grasp: bool = Field(
        False, description="An untrained policy of absolute actions commands a firm grasp, not mid-range."
    )
    log_every: PositiveInt = Field(200_000, description="Environment steps between lines of metrics.jsonl.")
    warm_start: str | None = Field(None, description="Agent directory whose weights to start from.")
    task: TaskConfig = TASK
    ppo: PPOConfig = PPOConfig()
    estimator: EstimatorConfig = EstimatorConfig.preset("small")
    ecrl: ECRLConfig = ECRLConfig()
    episodes: dict[str, Any] = Field(
        {"grasps": 32, "grasp_spread": 0.1, "engine": "compiled", "drag": 20.0},
        description="The task's settings that are others in training; engine and drag (thick air while gravity is low, "
        "compiled only) are its simulation's. null: as the task says.",
    )
    gravity: GravityConfig = GravityConfig()
    calm: CalmConfig = CalmConfig()
    evaluation: EvaluationConfig = EvaluationConfig()
    checkpoint: CheckpointConfig = CheckpointConfig()

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, data: Any) -> Any:
        return _lift(data) if isinstance(data, Mapping) else data

    @model_validator(mode="after")
    def _playable(self) -> RunConfig:
        try:
            _ = self.played
        except ValidationError as problem:
            raise ValueError(f"episodes.{explain(problem)}") from None
        return self

    @property
    def played(self) -> TaskConfig:
        """The task as training plays it, which is not quite as it is evaluated."""
        own = {name: value for name, value in self.episodes.items() if value is not None}
        physics = {name: own.pop(name) for name in ("engine", "drag") if name in own}
        return self.task.changed({**own, "simulation": physics})

    @property
    def encoding(self) -> str:
        return self.task.encoding

    @property
    def objects(self) -> str:
        return self.task.objects

    @property
    def name(self) -> str:
        """The run's customary directory name, ``oracle-vec_bps-geometric8-s0``."""
        return f"{self.kind}-{self.encoding}-{self.objects.replace(',', '+')}-s{self.seed}"

    @classmethod
    def preset(cls, name: str, changes: Mapping[str, Any] | None = None) -> RunConfig:
        """A preset by name, with changes as :meth:`build` takes them. Raises ConfigError."""
        return cls.build({"preset": name}, changes, name)

    @classmethod
    def from_yaml(cls, path: str | Path, changes: Mapping[str, Any] | None = None) -> RunConfig:
        """Settings from a YAML file, as :meth:`build` takes them. Raises ConfigError."""
        path = Path(path)
        return cls.build(_read_yaml(path), changes, str(path))

    @classmethod
    def build(
        cls, data: Mapping[str, Any], changes: Mapping[str, Any] | None = None, source: str = "settings"
    ) -> RunConfig:
        """Nested ``data``, then ``changes`` whose keys may be dotted (``{"task.objects": "cube"}``).

        A ``preset`` among the data names the settings that they change, the defaults where there is none.
        """
        files, data = presets(), dict(data)
        base = data.pop("preset", None)
        if base is not None:
            if not isinstance(base, str):
                raise ConfigError(f"{source}: preset: {short(base)}; allowed is one of {', '.join(files)}")
            if base not in files:
                raise ConfigError(f"{source}: preset {base!r} unknown{nearest(base, files)}")
            data = merge(_read_yaml(files[base]), data)
        try:
            tree = merge(cls().model_dump(), _lift(data))  # so that part of a nested default may be given
            for key, value in (changes or {}).items():
                nested: Any = value
                for part in reversed(key.split(".")):
                    nested = {part: nested}
                tree = merge(tree, _lift(nested))
            return cls.model_validate(tree)
        except ValidationError as problem:
            raise ConfigError(f"{source}: {explain(problem)}") from None
        except (TypeError, ValueError) as problem:
            raise ConfigError(f"{source}: {problem}") from None

    def to_dict(self) -> dict[str, Any]:
        """Plain data, every value resolved."""
        return self.model_dump(mode="json")

    def to_yaml(self) -> str:
        """The resolved settings as config.yaml holds them."""
        return yaml.safe_dump(self.to_dict(), sort_keys=False)


_SHORTHAND = ("encoding", "objects", "scaling", "randomization")


def _lift(data: Mapping[str, Any]) -> dict[str, Any]:
    """Move the task's settings given at the top level into ``task``; raises ValueError where both differ."""
    data = dict(data)
    given = {name: data.pop(name) for name in _SHORTHAND if name in data}
    if given:
        task = data.get("task", {})
        if not isinstance(task, (TaskConfig, Mapping)):
            raise ValueError(f"task: {short(task)}; allowed are keys and values")
        task = task.model_dump(exclude_unset=True) if isinstance(task, TaskConfig) else dict(task)
        for name, value in given.items():
            if name in task and task[name] != value:
                raise ValueError(f"{name} is {short(value)} at the top level and {short(task[name])} in task")
        data["task"] = {**task, **given}
    return data


def presets() -> dict[str, Path]:
    """Names and files of the presets shipped with the package."""
    folder = Path(str(resources.files("tactile_kit.runs"))) / "presets"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def _read_yaml(path: Path) -> dict[str, Any]:
    data = read_yaml(path, ConfigError)
    if data is None:
        raise ConfigError(f"{path}: is empty; expected keys and values, at the least a preset")
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: holds {type(data).__name__}, expected keys and values")
    return data


GROWS = ("steps",)
FREE = ("evaluation.", "checkpoint.", "num_workers", "workers")  # results do not depend on these


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Lines ``key: old -> new`` for every difference that forbids resuming: steps may grow, ``FREE`` may change."""
    before, after = _flatten(old), _flatten(new)
    lines = []
    for key in sorted(before.keys() | after.keys()):
        a, b = before.get(key, "(absent)"), after.get(key, "(absent)")
        if a == b or key.startswith(FREE):
            continue
        if key in GROWS and isinstance(a, int) and isinstance(b, int) and b >= a:
            continue
        lines.append(f"{key}: {a!r} -> {b!r}")
    return lines


def _flatten(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping) and value:
            flat.update(_flatten(value, f"{prefix}{key}."))
        else:
            flat[prefix + key] = list(value) if isinstance(value, tuple) else value
    return flat
