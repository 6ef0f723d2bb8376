"""What is there for an artefact: episode files, metrics and agent manifests, which it sees through ``Results`` only.

What isn't there is None, so that it is drawn as missing and never as a number.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

from reproduce.errors import ReproduceError
from reproduce.files import read_json, read_yaml
from reproduce.inventory import PLANNER
from reproduce.style import steps_text
from tactile_kit.evaluation.courses import Moment, read_courses
from tactile_kit.evaluation.rows import EpisodeRow, read_rows
from tactile_kit.files import read_text

ALIKE = 1.5  # ratio of environment steps up to which agents count as trained alike


@dataclass(frozen=True)
class Curve:
    """A run's success rates (N,) after environment steps (N,): without noise, held out, where the run measured that,
    else of training's own episodes."""

    run: str
    steps: tuple[int, ...]
    success: tuple[float, ...]


@dataclass(frozen=True)
class Results:
    """What an artefact can see."""

    content: dict[str, Any]
    markers: Path | None = (
        None  # folder of what evaluations made here have left beside their rows, with digests
    )

    @classmethod
    def load(cls, path: Path, markers: Path | None = None) -> Results:
        return cls(read_yaml(path), markers)

    @property
    def scale(self) -> str:
        return self.content["scale"]

    @property
    def seed(self) -> int:
        return self.content["seed"]

    def run_names(self, role: str) -> list[str]:
        """Runs of that role, whether they are there or not."""
        if role == PLANNER:
            return [PLANNER]
        return [name for name, run in self.content["runs"].items() if run["role"] == role]

    def rows(self, role: str, evaluation: str) -> list[EpisodeRow] | None:
        """Episodes of all seeds of a role, None where no run of it was evaluated."""
        names = [f"{name}/{evaluation}" for name in self.run_names(role)]
        files = {name: self.content["episodes"].get(name) for name in names}
        rows = [row for name, file in files.items() if file is not None for row in self._read(name, file)]
        return rows or None

    def courses(self, role: str, name: str) -> list[Moment]:
        """Courses of all seeds of a role; none where nobody measured them."""
        files = [self.content["courses"].get(f"{run}/{name}") for run in self.run_names(role)]
        return [line for file in files if file is not None for line in read_courses(file)]

    def costs(self, role: str, name: str) -> dict[str, Any]:
        """What is written beside the courses of a role's first run that has it; nothing where nobody measured it."""
        files = [self.content["costs"].get(f"{run}/{name}") for run in self.run_names(role)]
        return next((read_json(file) for file in files if file is not None), {})

    def measured(self, role: str, name: str) -> list[str]:
        """The runs of a role behind ``courses``."""
        return [run for run in self.run_names(role) if f"{run}/{name}" in self.content["courses"]]

    def evaluated(self, role: str, evaluation: str) -> list[str]:
        """The runs of a role behind ``rows``."""
        return [
            n for n in self.run_names(role) if self.content["episodes"].get(f"{n}/{evaluation}") is not None
        ]

    @cached_property
    def _episode_files(self) -> dict[str, list[EpisodeRow]]:
        return {}

    def _read(self, name: str, file: str) -> list[EpisodeRow]:
        if file not in self._episode_files:
            self._check_unaltered(name, Path(file))
            self._episode_files[file] = read_rows(file)
        return self._episode_files[file]

    def _check_unaltered(self, name: str, file: Path) -> None:
        marker = None if self.markers is None else self.markers / f"{name}.json"
        if marker is None or not marker.is_file() or not file.is_file():
            return
        wanted, found = read_json(marker)["digest"], sha256(file.read_bytes()).hexdigest()
        if found != wanted:
            raise ReproduceError(
                f"{file}: SHA-256 is {found[:16]}…, its evaluation left {wanted[:16]}… ({marker}): it was altered; "
                "delete it and run again, which evaluates anew"
            )

    def manifest(self, name: str) -> dict[str, Any] | None:
        """A run's agent.json, None where the run isn't there. The planner has none."""
        file = self.content["runs"][name]["agent"] if name != PLANNER else None
        return None if file is None else read_json(file)

    @property
    def cost(self) -> dict[str, Any] | None:
        """What the planner cost (``reproduce.planner``), None where nobody wrote it down."""
        return read_json(self.content["cost"]) if "cost" in self.content else None

    def steps_trained(self, names: Sequence[str]) -> list[int]:
        """Environment steps each of these runs was trained for, those before its warm start included."""
        manifests = [self.manifest(name) for name in names]
        return [steps_of(manifest) for manifest in manifests if manifest is not None]

    def unlike(self, roles: Sequence[str]) -> str:
        """How unlike the agents of these roles were trained, in words; empty where steps differ by half at most.

        Both all steps count and, of tactile agents, those since they have had an estimator.
        """
        for count, what in ((steps_of, ""), (_coupled_steps, " with the estimator")):
            manifests = {role: map(self.manifest, self.evaluated(role, "nominal")) for role in roles}
            steps = {role: [n for m in found if m and (n := count(m))] for role, found in manifests.items()}
            counts = [number for numbers in steps.values() for number in numbers]
            if counts and max(counts) > ALIKE * min(counts):
                said = ", ".join(
                    f"{role} {steps_text(counted)}" for role, counted in steps.items() if counted
                )
                return f"not trained alike{what}: {said}"
        return ""

    def lines(self, objects: str, expected: Sequence[str] = ()) -> list[str]:
        """Encodings of the oracle runs on that object set: those expected, there or not, then any others."""
        roles = (run["role"].split("-") for run in self.content["runs"].values())
        others = (encoding for kind, encoding, name in roles if (kind, name) == ("oracle", objects))
        return list(dict.fromkeys([*expected, *others]))

    def curves(self, role: str) -> list[Curve]:
        """Learning curves of the runs of that role that are there."""
        files = {name: self.content["runs"][name]["metrics"] for name in self.run_names(role)}
        return [read_curve(name, Path(file)) for name, file in files.items() if file is not None]


def steps_of(manifest: dict[str, Any]) -> int:
    """Environment steps behind an agent: its own and those of the agent it started from."""
    return int(manifest["steps"]) + int((manifest.get("warm_start") or {}).get("steps", 0))


def _coupled_steps(manifest: dict[str, Any]) -> int:
    """Environment steps of a tactile agent's own run; 0 for an oracle."""
    return int(manifest["steps"]) if manifest.get("kind") == "tactile" else 0


def read_curve(run: str, path: Path) -> Curve:
    """The curve in a metrics.jsonl: of its held-out points in the compiled physics where it has any, else of training.

    Evaluations in Bullet are another matter and left out. Raises ``ReproduceError`` naming file, line and value.
    """
    found: dict[str, list[tuple[int, float]]] = {"held_out/success": [], "success": []}
    lines = read_text(path, ReproduceError, "metrics file").splitlines()
    for number, line in enumerate(lines, start=1):
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise ReproduceError(f"{path}, line {number}: not valid JSON: {error}") from None
        if not isinstance(entry, dict):
            raise ReproduceError(f"{path}, line {number}: {type(entry).__name__}; allowed are objects")
        if entry.get("evaluation"):
            continue
        for name, points in found.items():
            if entry.get(name) is not None:
                points.append(_point(entry, name, points, f"{path}, line {number}"))
    points = found["held_out/success"] or found["success"]
    return Curve(run, tuple(step for step, _ in points), tuple(rate for _, rate in points))


def _point(
    entry: dict[str, Any], name: str, before: Sequence[tuple[int, float]], place: str
) -> tuple[int, float]:
    step, rate = entry.get("step"), entry[name]
    if not isinstance(step, int) or step < 0 or (before and step < before[-1][0]):
        raise ReproduceError(f"{place}: step = {step!r}; allowed are integers that never fall")
    if not isinstance(rate, (int, float)) or not 0 <= rate <= 1:
        raise ReproduceError(f"{place}: {name} = {rate!r}; allowed are numbers in [0, 1]")
    return step, float(rate)
