"""The planner's file: made object by object, continued after a kill, with its cost beside it, and its table column."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import pytest

import object_sets
from reproduce.artefacts import make
from reproduce.cells import read_cells
from reproduce.cli import main
from reproduce.errors import ReproduceError
from reproduce.inventory import BENCHMARK, PLANNER, inventory
from reproduce.pipeline import _command, _wanted
from reproduce.plan import ARTEFACTS, make_plan
from reproduce.planner import Record
from reproduce.prepare import prepare
from reproduce.readme import block
from reproduce.scales import load_scale
from tactile_kit.evaluation import read_rows

THINGS = {thing.id: thing for thing in object_sets.load("all")}
TINY = "{plans: 6, plans_at_goal: 6, horizon: 5, finalists: 2, repeats: 1}"
ROLE = "planner-truth-all"
COLUMN = "Planner (privileged)"


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """The command on the cube, two of the 24 goals, a tiny planner; and its arguments."""
    folder = tmp_path_factory.mktemp("planned")
    (folder / "tiny.yaml").write_text(TINY)
    arguments = [
        "evaluate-planner",
        "--out",
        str(folder / "nominal.csv"),
        "--planner",
        str(folder / "tiny.yaml"),
    ]
    arguments += ["--goals-per-case", "2", "--seed", "1"]
    assert main([*arguments, "--objects", "cube"]) == 0
    return folder, arguments


def test_the_command_writes_rows_and_their_cost(command):
    folder, _ = command
    rows, cost = read_rows(folder / "nominal.csv"), json.loads((folder / "nominal.json").read_text())
    assert [row.object for row in rows] == ["cube"] * 2 and {row.kind for row in rows} == {"planner"}
    assert cost["objects"]["cube"]["episodes"] == 2
    assert {"processor", "revision"} <= cost["objects"]["cube"].keys()
    assert cost["objects"]["cube"]["actions"] == sum(row.steps for row in rows)
    seconds = cost["objects"]["cube"]["cpu_seconds"]
    assert cost["cpu_seconds_per_action"] == pytest.approx(seconds / sum(row.steps for row in rows), abs=1e-3)
    assert cost["settings"]["planner"]["plans"] == 6 and cost["settings"]["seed"] == 1
    assert {file.name for file in folder.iterdir()} == {"nominal.csv", "nominal.json", "tiny.yaml"}


def test_what_is_there_is_not_played_again(command, capsys):
    folder, arguments = command
    before = {file.name: file.stat().st_mtime_ns for file in folder.iterdir()}
    assert main([*arguments, "--objects", "cube"]) == 0
    said = capsys.readouterr()
    last = json.loads(said.out.strip().splitlines()[-1])
    assert last["episodes"] == 2 and last["cpu_seconds_per_action"] > 0 and "episodes" not in said.err
    assert {file.name: file.stat().st_mtime_ns for file in folder.iterdir()} == before


def test_other_settings_are_refused_by_name(command, capsys):
    _, arguments = command
    arguments[arguments.index("--seed") + 1] = "2"
    assert main([*arguments, "--objects", "cube"]) == 2
    arguments[arguments.index("--seed") + 1] = "1"
    said = capsys.readouterr().err
    assert "seed = 1, asked for 2" in said and "nominal.json" in said and "\n" not in said.strip()


@pytest.mark.parametrize(
    "content, words",
    [
        ("{plnas: 6}", ["plnas", "nearest valid name: 'plans'"]),
        ("{steps_per_second: 90}", ["steps_per_second", "multiple of 60"]),
        ("[6]", ["PlannerConfig"]),
    ],
)
def test_faulty_settings_are_refused_by_file_and_name(tmp_path, capsys, content, words):
    (tmp_path / "faulty.yaml").write_text(content)
    arguments = ["--out", str(tmp_path / "a.csv"), "--planner", str(tmp_path / "faulty.yaml")]
    assert main(["evaluate-planner", *arguments]) == 2
    said = capsys.readouterr().err.strip()
    assert "\n" not in said and all(word in said for word in ["faulty.yaml", *words]), said


def planned(world, things=range(13), total=24):
    """Rows of the planner as drawn for a table, each with a seed of its own as real ones."""
    rows = [row for i in things for row in world.draw(ROLE, THINGS[i], 3 + i if total > 4 else 2, total)]
    return [replace(row, agent=PLANNER, seed=number) for number, row in enumerate(rows)]


def test_a_killed_run_ends_in_the_same_file(world, tmp_path):
    rows = planned(world, (8, 12, 2), total=4)
    whole, killed = tmp_path / "whole.csv", tmp_path / "killed.csv"
    record = Record(whole, {"seed": 0}, 4)
    for row in rows:
        record.add(row, 2.0)
    for number, row in enumerate(
        rows
    ):  # a new process for every episode, each killed while it wrote the next line
        record = Record(killed, {"seed": 0}, 4)
        assert record.seeds == {row.seed for row in rows[:number]}
        record.add(row, 2.0)
        if record.unfinished_file.is_file():
            with record.unfinished_file.open("a") as file:
                file.write('{"row": {"agent": "pla')
    assert killed.read_bytes() == whole.read_bytes()
    assert killed.with_suffix(".json").read_bytes() == whole.with_suffix(".json").read_bytes()
    assert [row.object_id for row in read_rows(killed)] == [2] * 4 + [8] * 4 + [12] * 4
    assert json.loads(whole.with_suffix(".json").read_text())["objects"]["cube"]["cpu_seconds"] == 8.0
    assert not record.unfinished_file.exists()


def test_an_object_killed_between_its_two_files_is_counted_once(world, tmp_path):
    rows, out = planned(world, (8, 12), total=4), tmp_path / "nominal.csv"
    record = Record(out, {}, 4)
    for row in rows[:7]:
        record.add(row, 2.0)
    before, lines = out.read_bytes(), record.unfinished_file.read_text()
    record.add(rows[7], 2.0)
    after, cost = out.read_bytes(), out.with_suffix(".json").read_bytes()
    out.write_bytes(before)  # the cost was written, the episodes were not
    line = json.dumps({"row": asdict(rows[7]), "cpu_seconds": 2.0})
    record.unfinished_file.write_text(f"{lines}{line}\n")
    Record(out, {}, 4)
    assert (out.read_bytes(), out.with_suffix(".json").read_bytes()) == (after, cost)


@pytest.mark.parametrize(
    "content", ["{}\n", '{"settings": {}}\nnot JSON\n', '{"settings": {}}\n{"row": {}}\n']
)
def test_a_damaged_file_is_refused_by_name_and_line(tmp_path, content):
    (tmp_path / "a.unfinished.jsonl").write_text(content)
    with pytest.raises(ReproduceError, match=rf"a\.unfinished\.jsonl, line {content.count(chr(10))}"):
        Record(tmp_path / "a.csv", {}, 4)


def table(world, folder):
    (folder / "tables").mkdir(exist_ok=True)
    outputs = [folder / "tables" / "table1.csv", folder / "tables" / "table1.tex"]
    make("table1", world.results, outputs)
    return {cell.row: cell for cell in read_cells(outputs[0]) if cell.column == COLUMN}, outputs[
        1
    ].read_text()


def test_the_table_has_its_rates_and_its_cost(world, tmp_path):
    world.planned(planned(world), 0.234)
    world.evaluated(
        BENCHMARK[0],
        "nominal",
        [row for i in range(13) for row in world.draw(BENCHMARK[0], THINGS[i], 6, 12)],
    )
    cells, tex = table(world, tmp_path)
    assert (cells["Round"].successes, cells["Round"].n, cells["Round"].paper) == (8 + 15, 48, None)
    assert cells["Convex"].ours == pytest.approx((4 + 5 + 6 + 7 + 11 + 12) / 144, abs=1e-6)
    assert {cell.note for cell in cells.values()} == {"no training; 0.23 s of one core an action"}
    assert {cell.runs for cell in cells.values()} == {PLANNER} and not cells["Round"].steps_trained
    assert "0.23 s of one core an action" in tex and tex.count("Planner") == 1
    assert any(
        line.startswith("     & our episodes") and line.endswith(r"& 48 \\") for line in tex.splitlines()
    )
    (tmp_path / "claims.csv").write_text("verdict\nreproduced\n")
    text = block(tmp_path)
    assert (
        f"| **{23 / 48:.2f}** [0.34, 0.62] |" in text
        and "| no training; 0.23 s of one core an action |" in text
    )


def test_only_whole_classes_are_measured(world, tmp_path):
    world.planned(planned(world, (5, 8, 12)), 0.2)
    cells, tex = table(world, tmp_path)
    assert cells["Round"].status == "measured" and "no training" in tex
    assert cells["Convex"].status == "missing" and "[1, 2, 3, 4, 9]" in cells["Convex"].note
    assert cells["Non-convex"].status == "missing" and cells["Non-convex"].ours is None


def test_the_pipeline_takes_the_file_where_it_is_there(world, tmp_path):
    plan = make_plan(load_scale("small"), "pretrained", tmp_path / "out", tmp_path / "agents")
    content = inventory(plan, "table1")
    assert "planner/nominal" not in content["episodes"] and "cost" not in content
    folder = plan.out / "episodes" / PLANNER
    record = Record(folder / "nominal.csv", {}, 4)
    for row in planned(world, (8,), total=4):
        record.add(row, 2.0)
    needs = json.loads(prepare(plan).read_text())["needs"]
    files = [str(folder / "nominal.csv"), str(folder / "nominal.json")]
    for artefact in ("table1", "report"):
        assert needs[artefact]["found"] == files and needs[artefact]["episodes"] == []
    assert all(not needs[name]["found"] for name in ("table2", "claims", "violin"))


def test_the_workflow_makes_no_such_file_and_needs_no_agent_for_it(world, tmp_path):
    plan = make_plan(load_scale("small"), "pretrained", tmp_path / "out", tmp_path / "agents")
    record = Record(plan.out / "episodes" / PLANNER / "nominal.csv", {}, 4)
    for row in planned(world, (8,), total=4):
        record.add(row, 2.0)
    config = prepare(plan)
    wanted = _wanted(_command(plan, config, 1, None), config)
    assert set(wanted) == set(ARTEFACTS)
