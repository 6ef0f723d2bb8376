"""From a scale to the list of everything there is to do: runs, evaluations, artefacts, with their files.

A plan is a pure function of the scale, of where agents come from and of which agents are there.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from reproduce.errors import ScaleError
from reproduce.files import ROOT
from reproduce.scales import EvaluationGroup, RunGroup, Scale, split_variant
from tactile_kit.errors import nearest
from tactile_kit.simulation.engines import engine_of

FIGURES = (
    "object_sets",
    "learning",
    "violin",
    "success",
    "transfer",
    "sensitivity",
    "following",
    "turning",
    "failures",
    "complex",
    "extent",
    "confusion",
)
TABLES = ("table1", "table2", "estimators")
ARTEFACTS = (*TABLES, *FIGURES, "film", "claims", "report")


@dataclass(frozen=True)
class Run:
    """One agent: trained here or shipped. ``role`` is the name without the seed."""

    name: str
    role: str
    kind: str
    variant: str
    set: str
    seed: int
    preset: str
    warm_start: str | None
    teacher: str | None
    job: str  # the training job it belongs to
    directory: Path
    curves: bool = True  # whether an oracle run belongs to the learning curves

    @property
    def sources(self) -> tuple[str, ...]:
        """The runs that must be there before this one is trained."""
        return tuple(name for name in (self.warm_start, self.teacher) if name is not None)


@dataclass(frozen=True)
class Evaluation:
    """One episode file to make."""

    run: Run
    group: EvaluationGroup
    file: Path

    @property
    def name(self) -> str:
        return f"{self.run.name}/{self.group.name}"


@dataclass(frozen=True)
class Plan:
    """Everything one invocation is about."""

    scale: Scale
    source: str  # pretrained | scratch
    out: Path
    runs: tuple[Run, ...]
    evaluations: tuple[Evaluation, ...]

    @property
    def pipeline(self) -> Path:
        """State of the pipeline (not a result): job files, markers, logs, Snakemake's own records."""
        return self.out / ".pipeline"

    @property
    def trains(self) -> bool:
        return self.source == "scratch"

    def available(self, run: Run) -> bool:
        """Whether the run's agent is there or will be made."""
        return self.trains or self.manifest(run).is_file()

    def possible(self, evaluation: Evaluation) -> bool:
        """Whether an evaluation can be made: its agent is available, and its world installed."""
        return self.available(evaluation.run) and engine_of(evaluation.group.world).installed

    def has_curve(self, run: Run) -> bool:
        return self.trains or (run.directory / "metrics.jsonl").is_file()

    def manifest(self, run: Run) -> Path:
        """The agent's manifest: what evaluations of a shipped agent depend on."""
        return run.directory / "agent.json"

    def job_of(self, name: str) -> str:
        """The training job that makes the run of that name."""
        return next(run.job for run in self.runs if run.name == name)

    def outputs(self, artefact: str) -> list[Path]:
        """The files an artefact consists of; the first one is what people open."""
        if artefact in TABLES:
            return [self.out / "tables" / f"{artefact}.{suffix}" for suffix in ("csv", "tex")]
        if artefact in FIGURES:
            return [self.out / "figures" / f"{artefact}.{suffix}" for suffix in ("png", "svg", "csv")]
        others = {"claims": "claims.csv", "film": "report/film.csv", "report": "report/index.html"}
        return [self.out / others[artefact]]

    def jobs(self) -> dict[str, list[Run]]:
        """Training jobs and the runs each trains, one after another."""
        jobs: dict[str, list[Run]] = {}
        for run in self.runs:
            jobs.setdefault(run.job, []).append(run)
        return jobs


def default_out(scale: str, source: str) -> Path:
    """``results`` holds what the shipped agents give at scale ``small``; everything else has its own folder there."""
    results = ROOT / "results"
    if scale != "small":
        return results / Path(scale).stem
    return results if source == "pretrained" else results / "scratch"


def make_plan(scale: Scale, source: str, out: Path, agents: Path | None = None) -> Plan:
    """The plan of a scale.

    Args:
        source: ``pretrained`` takes agents as they are in ``agents`` (default ``results/agents`` of the repository)
            and trains nothing; ``scratch`` trains them below ``out``.
        out: where results go.
        agents: folder of agent directories.

    Raises ``ScaleError`` where the scale names runs that don't exist or names one twice.
    """
    out = Path(out).resolve()
    if agents is None:
        agents = out / "agents" if source == "scratch" else ROOT / "results" / "agents"
    runs = [
        run
        for number, group in enumerate(scale.runs)
        for run in _expand(group, number, Path(agents).resolve())
    ]
    names = [run.name for run in runs]
    for name in names:
        if names.count(name) > 1:
            raise ScaleError(f"scale {scale.name}: run {name} is named by two groups; allowed is one")
    for run in runs:
        for setting in ("warm_start", "teacher"):
            needed = getattr(run, setting)
            if needed is not None and needed not in names:
                raise ScaleError(
                    f"scale {scale.name}: {setting} {needed!r} of {run.name} unknown{nearest(needed, names)}"
                )
    evaluations = []
    for group in scale.evaluations:
        for role in group.runs:
            found = [
                run for run in runs if run.role == role and (group.seeds is None or run.seed in group.seeds)
            ]
            if not found:
                raise ScaleError(
                    f"scale {scale.name}: evaluation {group.name} names {role!r}"
                    + nearest(role, {run.role for run in runs})
                )
            evaluations += [
                Evaluation(run, group, out / "episodes" / run.name / f"{group.name}.csv") for run in found
            ]
    return Plan(scale, source, out, tuple(runs), tuple(evaluations))


def _expand(group: RunGroup, number: int, agents: Path) -> list[Run]:
    runs = []
    for seed in group.seeds:
        for variant in group.variants:
            for objects in group.sets:
                role = f"{group.kind}-{variant}-{objects}"
                name = f"{role}-s{seed}"
                warm = _fill("warm_start", group.warm_start, variant, objects, seed)
                teacher = _fill("teacher", group.teacher, variant, objects, seed)
                job = f"group{number}-{group.kind}" if group.together else name
                runs.append(
                    Run(
                        name,
                        role,
                        group.kind,
                        variant,
                        objects,
                        seed,
                        group.preset,
                        warm,
                        teacher,
                        job,
                        agents / name,
                        group.curves,
                    )
                )
    return runs


def _fill(setting: str, template: str | None, variant: str, objects: str, seed: int) -> str | None:
    if template is None:
        return None
    try:
        return template.format(encoding=split_variant(variant)[0], set=objects, seed=seed)
    except (KeyError, IndexError, ValueError):
        raise ScaleError(
            f"{setting} {template!r}: allowed are the fields {{encoding}}, {{set}} and {{seed}}"
        ) from None
