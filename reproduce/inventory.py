"""Which files an artefact reads (written by ``prepare``), and the reader the artefact uses.

An artefact sees episode files, metrics and agent manifests through ``Results`` only. What isn't there is None, so
that it is drawn as missing and never as a number.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from reproduce.errors import ReproduceError
from reproduce.files import read_json, read_yaml
from reproduce.plan import Plan
from reproduce.style import steps_text
from tactile_kit.evaluation.rows import EpisodeRow, read_rows

TRANSFER = "mujoco"  # the evaluation in another simulator
PLANNER = "planner"  # its episodes are found, not made by the pipeline
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
ALIKE = 1.5  # ratio of environment steps up to which agents count as trained alike
_SETS = ("cube", "cuboids", "geometric8")
_LINES = ("vec_bps", "bps", "pointnet", "pos_rot", "pos", "none")
CURVES = {
    objects: (*_LINES, "mesh") if objects == "geometric8" else _LINES for objects in _SETS
}  # Fig. 5's lines
_CURVE_ROLES = tuple(f"oracle-{line}-{objects}" for objects in _SETS for line in CURVES[objects])

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
# artefact -> (role, evaluation) pairs it reads; roles whose learning curves it reads
NEEDS: dict[str, tuple[list[tuple[str, str]], tuple[str, ...]]] = {
    **{name: (pairs, ()) for name, pairs in _NOMINAL.items()},
    "table1": ([*_NOMINAL["table1"], *_BESIDE], ()),
    "object_sets": ([], ()),
    "learning": ([], _CURVE_ROLES),
    "claims": (_ALL, _CURVE_ROLES),
    "report": ([*_ALL, *_BESIDE], _CURVE_ROLES),
}


def inventory(plan: Plan, artefact: str) -> dict[str, Any]:
    """The files ``artefact`` reads, as plain data: paths, and None where a file isn't there and won't be made."""
    pairs, curves = NEEDS[artefact]
    roles = {role for role, _ in pairs} | set(curves)
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
                if run.role in curves and run.curves and plan.has_curve(run)
                else None,
            }
            for run in plan.runs
            if run.role in roles and (run.curves or run.role in {role for role, _ in pairs})
        },
        "episodes": episodes,
        **cost,
    }


def found(content: dict[str, Any]) -> list[str]:
    """The files of an inventory that are there already, whatever the pipeline makes."""
    files = [file for name, file in content["episodes"].items() if file and not is_made(name)]
    return files + ([content["cost"]] if "cost" in content else [])


def is_made(episodes: str) -> bool:
    """Whether the pipeline makes the episode file ``RUN/EVALUATION``."""
    return not episodes.startswith(f"{PLANNER}/")


@dataclass(frozen=True)
class Curve:
    """A run's training metrics: environment steps (N,) and success rates (N,), as logged."""

    run: str
    steps: tuple[int, ...]
    success: tuple[float, ...]


@dataclass(frozen=True)
class Results:
    """What an artefact can see."""

    content: dict[str, Any]

    @classmethod
    def load(cls, path: Path) -> Results:
        return cls(read_yaml(path))

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
        files = [self.content["episodes"].get(f"{name}/{evaluation}") for name in self.run_names(role)]
        rows = [row for file in files if file is not None for row in self._read(file)]
        return rows or None

    def evaluated(self, role: str, evaluation: str) -> list[str]:
        """The runs of a role behind ``rows``."""
        return [
            n for n in self.run_names(role) if self.content["episodes"].get(f"{n}/{evaluation}") is not None
        ]

    @cached_property
    def _episode_files(self) -> dict[str, list[EpisodeRow]]:
        return {}

    def _read(self, file: str) -> list[EpisodeRow]:
        if file not in self._episode_files:
            self._episode_files[file] = read_rows(file)
        return self._episode_files[file]

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
    """The training lines of a metrics.jsonl (those of held-out evaluations are another matter and left out).

    Raises ``ReproduceError`` naming file, line and value.
    """
    steps: list[int] = []
    success: list[float] = []
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        raise ReproduceError(f"{path}: no such metrics file") from None
    for number, line in enumerate(lines, start=1):
        try:
            entry = json.loads(line)
        except json.JSONDecodeError as error:
            raise ReproduceError(f"{path}, line {number}: not valid JSON: {error}") from None
        if entry.get("evaluation") or entry.get("success") is None:
            continue
        step, rate = entry.get("step"), entry["success"]
        if not isinstance(step, int) or step < 0 or (steps and step < steps[-1]):
            raise ReproduceError(
                f"{path}, line {number}: step = {step!r}; allowed are integers that never fall"
            )
        if not isinstance(rate, (int, float)) or not 0 <= rate <= 1:
            raise ReproduceError(f"{path}, line {number}: success = {rate!r}; allowed are numbers in [0, 1]")
        steps.append(step)
        success.append(float(rate))
    return Curve(run, tuple(steps), tuple(success))
