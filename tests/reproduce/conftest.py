"""Episode files with known success rates: counts are exact, so that what a table must show is known in closed form."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import object_sets
import randomization
from reproduce.artefacts import make
from reproduce.artefacts.learning import CURVES
from reproduce.files import dump_yaml
from reproduce.inventory import ABLATED, BENCHMARK, ORACLE, PLANNER, TACTILE
from reproduce.plan import FIGURES, TABLES
from reproduce.results import Results
from tactile_kit.evaluation import EpisodeRow, write_rows

ROUND, NON_CONVEX = (5, 12), (0, 6, 7, 10, 11)


def episode(
    role: str, held, given, number: int, success: bool, theta: float, drop: bool, size: int = 0
) -> EpisodeRow:
    kind, encoding, _ = role.split("-")
    return EpisodeRow(
        f"{role}-s0", kind, encoding, 0, held.id, held.name, size, *map(float, held.extents), given.id, given.name,
        *map(float, given.extents), number % 24, number // 24, number, theta, min(theta, 0.3), success, drop, "", 100,
    )  # fmt: skip


def episodes(role: str, held, successes: int, total: int, given=None, size: int = 0) -> list[EpisodeRow]:
    """``total`` episodes of which the first ``successes`` succeed; the others end far away, every third dropped."""
    rng = randomization.stream(0, "test", role, held.name, size)
    rows = []
    for number in range(total):
        success = number < successes
        theta = float(rng.uniform(0.02, 0.39)) if success else float(rng.uniform(0.5, 3.0))
        rows.append(
            episode(role, held, given or held, number, success, theta, not success and number % 3 == 0, size)
        )
    return rows


def paper_rate(role: str, item: int) -> float:
    """The paper's Table I rate of the object's class; for ablations as Table II says."""
    column = 1 if item in ROUND else 2 if item in NON_CONVEX else 0
    table = {
        BENCHMARK[0]: (0.97, 0.99, 0.95), BENCHMARK[1]: (0.94, 0.99, 0.85), BENCHMARK[2]: (0.90, 0.66, 0.90),
        BENCHMARK[3]: (0.70, 0.51, 0.68),
    }  # fmt: skip
    if role in table:
        return table[role][column]
    factor = dict(zip(ABLATED.values(), (0.974, 0.983, 0.70, 1.0), strict=True))[role]
    return table[TACTILE][column] * factor


class World:
    """A folder of episode files, metrics and manifests, and the ``Results`` over it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.runs: dict[str, dict] = {}
        self.episodes: dict[str, str | None] = {}
        self.cost: dict[str, str] = {}
        self.courses: dict[str, str] = {}
        self.costs: dict[str, str] = {}
        self.films: list[str] = []

    draw = staticmethod(episodes)

    def run(self, role: str, seed: int = 0, steps: int = 123_456, curve: np.ndarray | None = None) -> str:
        name = f"{role}-s{seed}"
        directory = self.folder / "agents" / name
        directory.mkdir(parents=True, exist_ok=True)
        kind, encoding, objects = role.split("-")
        manifest = {
            "schema": 1, "kind": kind, "encoding": encoding, "objects": objects, "seed": seed, "algorithm": "ppo",
            "steps": steps, "hours": 0.25, "warm_start": None,
        }  # fmt: skip
        (directory / "agent.json").write_text(json.dumps(manifest))
        self.runs[name] = {"role": role, "agent": str(directory / "agent.json"), "metrics": None}
        if curve is not None:
            lines = [{"step": int(1000 * (i + 1)), "success": float(v)} for i, v in enumerate(curve)]
            (directory / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
            self.runs[name]["metrics"] = str(directory / "metrics.jsonl")
        return name

    def absent(self, role: str, seed: int = 0) -> None:
        self.runs[f"{role}-s{seed}"] = {"role": role, "agent": None, "metrics": None}

    def evaluated(self, role: str, evaluation: str, rows: list[EpisodeRow], seed: int = 0) -> None:
        name = f"{role}-s{seed}"
        if name not in self.runs:
            self.run(role, seed)
        file = self.folder / "episodes" / name / f"{evaluation}.csv"
        write_rows(file, rows)
        self.episodes[f"{name}/{evaluation}"] = str(file)

    def planned(self, rows: list[EpisodeRow], cpu_seconds_per_action: float) -> None:
        file = write_rows(self.folder / "episodes" / PLANNER / "nominal.csv", rows)
        file.with_suffix(".json").write_text(json.dumps({"cpu_seconds_per_action": cpu_seconds_per_action}))
        self.episodes[f"{PLANNER}/nominal"] = str(file)
        self.cost = {"cost": str(file.with_suffix(".json"))}

    def page(self, out: Path) -> str:
        """The report over this world, with everything it shows, made in ``out``."""
        for name in (*TABLES, *FIGURES, "claims", "report"):
            if name in TABLES:
                outputs = [out / "tables" / f"{name}.{suffix}" for suffix in ("csv", "tex")]
            elif name in FIGURES:
                outputs = [out / "figures" / f"{name}.{suffix}" for suffix in ("png", "svg", "csv")]
            else:
                outputs = [out / "claims.csv"] if name == "claims" else [out / "report" / "index.html"]
            make(name, self.results, outputs)
        return (out / "report" / "index.html").read_text()

    @property
    def results(self) -> Results:
        content = {
            "artefact": "test", "scale": "test", "description": "Drawn for a test.", "source": "pretrained", "seed": 0,
            "runs": self.runs, "episodes": self.episodes, "courses": self.courses,
            "costs": self.costs, "films": self.films, **self.cost,
        }  # fmt: skip
        file = self.folder / "inventory.yaml"
        file.write_text(dump_yaml(content))
        return Results.load(file)


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


def fill(world: World, total: int = 200) -> World:
    """A world in which everything turned out as in the paper."""
    things = {thing.id: thing for thing in object_sets.load("all")}
    for role in (*BENCHMARK, *ABLATED.values()):
        rows = []
        for item in range(13):
            rows += episodes(role, things[item], round(total * paper_rate(role, item)), total)
        world.evaluated(role, "nominal", rows)
    for role, rate in ((ORACLE, 0.94), (TACTILE, 0.5)):
        rows = [
            row for item in (13, 14, 15) for row in episodes(role, things[item], round(total * rate), total)
        ]
        world.evaluated(role, "complex", rows)
    rng = np.random.default_rng(0)
    for evaluation in ("extent-true", "extent-fixed"):
        rng = np.random.default_rng(0)
        rows = []
        for item in range(8):
            for size in range(1, 9):
                held = things[item].with_extents(rng.uniform(0.045, 0.09, 3))
                away = max(abs(held.extents - 0.0675)) / 0.0225
                rate = 0.88 if evaluation == "extent-true" else 0.9 - 0.6 * away**2
                rows += episodes(TACTILE, held, round(24 * rate), 24, things[item], size)
        world.evaluated(TACTILE, evaluation, rows)
    rows = []
    for given in range(13):
        for held in range(13):
            rate = (
                0.92
                if given == held or (given, held) == (8, 6)
                else 0.15 + 0.5 * ((given * 7 + held * 3) % 5) / 5
            )
            rows += episodes(TACTILE, things[held], round(24 * rate), 24, things[given])
    world.evaluated(TACTILE, "confusion", rows)
    ends = {
        "vec_bps": 0.9,
        "bps": 0.9,
        "pointnet": 0.62,
        "pos_rot": 0.55,
        "mesh": 0.54,
        "pos": 0.56,
        "none": 0.4,
    }
    for objects, lines in CURVES.items():
        for line in lines:
            for seed in (0, 1, 2):
                end = 0.9 if objects == "cube" else ends[line]
                end -= {"pos": 0.03 if objects == "cube" else 0, "none": 0.05}.get(line, 0)
                end += (seed - 1) * (0.06 if line == "pos_rot" else 0.01)
                curve = end * (1 - np.exp(-np.arange(100) / 25.0))
                world.run(f"oracle-{line}-{objects}", seed, curve=curve)
    return world


@pytest.fixture(scope="session")
def paper_world(tmp_path_factory: pytest.TempPathFactory) -> World:
    """Made once; read only."""
    return fill(World(tmp_path_factory.mktemp("paper_world")))


@pytest.fixture
def full_world(paper_world: World, world: World) -> World:
    """The paper's world, of which a test may overwrite parts: new files go to the test's own folder."""
    world.runs, world.episodes = dict(paper_world.runs), dict(paper_world.episodes)
    return world
