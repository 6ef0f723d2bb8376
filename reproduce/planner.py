"""The planner's episode file and what it cost, made object by object: a killed run goes on with the next episode.

Beside ``NAME.csv`` with the episodes of finished objects stand ``NAME.json``, their cost and the settings, and while an
object is being played ``NAME.unfinished.jsonl``, one line an episode.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from reproduce.errors import ReproduceError
from reproduce.files import read_json, read_yaml, write_atomic
from reproduce.stages.evaluate import summary_of
from tactile_kit.evaluation.cases import GOALS
from tactile_kit.evaluation.rows import EpisodeRow, read_rows, write_rows
from tactile_kit.evaluation.schedule import STEPS_PER_SECOND

if TYPE_CHECKING:
    from tactile_kit.planning import PlannerConfig

Played = tuple[EpisodeRow, float]  # and seconds of one core


class Record:
    """What has been played so far under certain settings.

    Args:
        out: the episode file (CSV).
        settings: plain data that decides the episodes and how they are planned.
        expected: episodes an object.

    Raises:
        ReproduceError: ``out`` was made under other settings, or its cost is not there.
    """

    def __init__(self, out: Path, settings: dict[str, Any], expected: int) -> None:
        self.out, self.settings, self.expected = out, settings, expected
        self.cost_file = out.with_suffix(".json")
        self.unfinished_file = out.with_suffix(".unfinished.jsonl")
        self.costs: dict[str, dict[str, Any]] = {}
        self.rows: dict[int, EpisodeRow] = {}  # of finished objects, by seed
        if out.is_file():
            content = read_json(self.cost_file)
            self._must_agree(self.cost_file, content.get("settings", {}))
            rows = read_rows(out)
            names = {row.object for row in rows}
            self.costs = {name: cost for name, cost in content["objects"].items() if name in names}
            self.rows = {row.seed: row for row in rows if row.object in self.costs}
        self.unfinished: dict[int, Played] = self._read_unfinished()
        self._finish()

    @property
    def seeds(self) -> set[int]:
        """Of all episodes played."""
        return self.rows.keys() | self.unfinished.keys()

    def add(self, row: EpisodeRow, cpu_seconds: float) -> None:
        """Keep an episode; an object that is complete with it goes to the episode file."""
        if not self.unfinished:
            write_atomic(self.unfinished_file, json.dumps({"settings": self.settings}) + "\n")
        self.unfinished[row.seed] = (row, cpu_seconds)
        with self.unfinished_file.open("a", encoding="utf-8") as file:
            file.write(_line(row, cpu_seconds))
        self._finish()

    def _finish(self) -> None:
        counts: dict[str, int] = {}
        for row, _ in self.unfinished.values():
            counts[row.object] = counts.get(row.object, 0) + 1
        complete = [name for name, count in counts.items() if count == self.expected]
        for name in complete:
            played = [pair for pair in self.unfinished.values() if pair[0].object == name]
            actions, seconds = sum(row.steps for row, _ in played), sum(cost for _, cost in played)
            self.costs[name] = {
                "episodes": len(played), "actions": actions, "cpu_seconds": round(seconds, 2),
                **_provenance(),
            }  # fmt: skip
            self.rows |= {row.seed: row for row, _ in played}
            for row, _ in played:
                del self.unfinished[row.seed]
        if complete:
            # In this order: a kill in between leaves an object to be counted again, never one without its cost.
            self._write()
            if not self.unfinished:
                self.unfinished_file.unlink(missing_ok=True)

    def _write(self) -> None:
        rows = sorted(self.rows.values(), key=lambda row: (row.object_id, row.goal, row.episode))
        order = list(dict.fromkeys(row.object for row in rows))
        costs = {name: self.costs[name] for name in order}
        content = {
            "cpu_seconds_per_action": round(per_action(costs), 4), "objects": costs, "settings": self.settings,
        }  # fmt: skip
        write_atomic(self.cost_file, json.dumps(content, indent=1) + "\n")
        write_rows(self.out, rows)

    def _read_unfinished(self) -> dict[int, Played]:
        if not self.unfinished_file.is_file():
            return {}
        text = self.unfinished_file.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]  # the process may have been killed while it wrote the last line
        if whole != text:
            write_atomic(self.unfinished_file, whole)
        found = {}
        for number, line in enumerate(whole.splitlines(), start=1):
            try:
                entry = json.loads(line)
                if number == 1:
                    self._must_agree(self.unfinished_file, entry["settings"])
                    continue
                row, cpu_seconds = EpisodeRow(**entry["row"]), float(entry["cpu_seconds"])
            except (json.JSONDecodeError, KeyError, TypeError):
                raise ReproduceError(
                    f"{self.unfinished_file}, line {number}: no episode; name another file or delete it"
                ) from None
            if row.seed not in self.rows:
                found[row.seed] = (row, cpu_seconds)
        return found

    def _must_agree(self, file: Path, found: dict[str, Any]) -> None:
        names = sorted(found.keys() | self.settings.keys())
        other = [n for n in names if found.get(n) != self.settings.get(n)]
        if other:
            said = "; ".join(f"{n} = {found.get(n)}, asked for {self.settings.get(n)}" for n in other)
            raise ReproduceError(f"{file}: made with other settings: {said}; name another file or delete it")


def evaluate_to(
    out: Path,
    objects: str = "paper",
    *,
    planner: Path | None = None,
    episodes_per_goal: int = 1,
    goals_per_case: int = GOALS,
    seed: int = 0,
    randomization: str = "default",
    num_workers: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Evaluates the planner into ``out``; objects that are there already are kept.

    Args:
        planner: YAML file of planner settings.
        objects, episodes_per_goal, goals_per_case, seed, randomization, num_workers: as in ``evaluate_planner``.
        progress: called with (episodes done, episodes in all) after every episode.

    Returns a summary of ``objects``, as of ``stages.evaluate.evaluate_to``, with ``cpu_seconds_per_action``.
    Raises ``ReproduceError`` where ``out`` was made under other settings.
    """
    import object_sets
    from tactile_kit.evaluation.planner import evaluate_planner

    config = _planner_settings(planner)
    names = [thing.name for thing in object_sets.select(objects)]
    settings = {
        "episodes_per_goal": episodes_per_goal,
        "goals_per_case": goals_per_case,
        "seed": seed,
        "randomization": randomization,
        "steps_per_second": STEPS_PER_SECOND,
        "planner": config.model_dump(mode="json"),
    }
    record = Record(Path(out), settings, episodes_per_goal * goals_per_case)
    total = len(names) * record.expected
    played = evaluate_planner(
        objects, planner=config, episodes_per_goal=episodes_per_goal, goals_per_case=goals_per_case, seed=seed,
        randomization=randomization, num_workers=num_workers, done=record.seeds,
    )  # fmt: skip
    for row, cpu_seconds in played:
        record.add(row, cpu_seconds)
        if progress is not None:
            there = [*record.rows.values(), *(row for row, _ in record.unfinished.values())]
            progress(sum(row.object in names for row in there), total)
    rows = [row for row in record.rows.values() if row.object in names]
    cost = per_action({name: record.costs[name] for name in names})
    return {**summary_of(rows, out), "cpu_seconds_per_action": cost}


def _planner_settings(path: Path | None) -> PlannerConfig:
    from tactile_kit.planning import PlannerConfig

    content = {} if path is None else read_yaml(path) or {}
    try:
        return PlannerConfig.model_validate(content)
    except ValueError as error:
        raise ReproduceError(f"{path}: {' '.join(str(error).split())}") from None


def per_action(costs: dict[str, dict[str, Any]]) -> float:
    """Seconds of one core an action, over the objects of a cost file."""
    return sum(c["cpu_seconds"] for c in costs.values()) / sum(c["actions"] for c in costs.values())


def _line(row: EpisodeRow, cpu_seconds: float) -> str:
    return json.dumps({"row": asdict(row), "cpu_seconds": cpu_seconds}) + "\n"


def _provenance() -> dict[str, Any]:
    from tactile_kit.runs.directory import hardware, revision

    return {"processor": hardware()["processor"], "revision": revision()}
