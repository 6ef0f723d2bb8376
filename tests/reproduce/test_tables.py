"""Tables hold exactly the rates of the episode files, Wilson's closed form, and mark what is missing."""

from __future__ import annotations

import csv
import json

import pytest

import object_sets
from reproduce.artefacts import make
from reproduce.cells import paper_values, read_cells
from reproduce.inventory import ABLATED, BENCHMARK, TACTILE
from tactile_kit.evaluation import wilson

THINGS = {thing.id: thing for thing in object_sets.load("all")}
CLASSES = {"Convex": (1, 2, 3, 4, 8, 9), "Round": (5, 12), "Non-convex": (0, 6, 7, 10, 11)}
PAPER = {  # of Table I, typed in again from the paper
    ("Convex", "Oracle VecBPS"): 0.97, ("Convex", "Oracle Pos"): 0.94, ("Convex", "Estimator VecBPS"): 0.90,
    ("Convex", "Estimator Pos"): 0.70, ("Round", "Oracle VecBPS"): 0.99, ("Round", "Oracle Pos"): 0.99,
    ("Round", "Estimator VecBPS"): 0.66, ("Round", "Estimator Pos"): 0.51, ("Non-convex", "Oracle VecBPS"): 0.95,
    ("Non-convex", "Oracle Pos"): 0.88, ("Non-convex", "Estimator VecBPS"): 0.90, ("Non-convex", "Estimator Pos"): 0.68,
}  # fmt: skip


def tables(world, name, folder):
    outputs = [folder / f"{name}.csv", folder / f"{name}.tex"]
    make(name, world.results, outputs)
    return {(cell.row, cell.column): cell for cell in read_cells(outputs[0])}, outputs[1].read_text()


def rows_of(tex):
    """The four lines of each class of Table I, cut into cells."""
    lines = [line.removesuffix(r"\\").split(" & ") for line in tex.splitlines() if " & " in line]
    lines = [[cell.strip() for cell in line] for line in lines]
    starts = [i for i, line in enumerate(lines) if line[0] in CLASSES]
    return {lines[i][0]: lines[i : i + 4] for i in starts}


def test_table1_holds_the_rates_of_the_files(world, tmp_path):
    successes = {
        role: {item: 3 + (item * 5 + place) % 8 for item in range(13)} for place, role in enumerate(BENCHMARK)
    }
    for role in BENCHMARK:
        world.evaluated(
            role,
            "nominal",
            [row for i in range(13) for row in world.draw(role, THINGS[i], successes[role][i], 12)],
        )
    ordered = [column["name"] for column in paper_values("table1")["columns"]]
    filtered = [row for i in range(13) for row in world.draw(TACTILE, THINGS[i], 2 + i % 3, 12)]
    world.evaluated(TACTILE, "kalman", filtered)
    cells, tex = tables(world, "table1", tmp_path)
    columns = ("Oracle VecBPS", "Oracle Pos", "Estimator VecBPS", "Estimator Pos")
    beside = ("Finger cell", "Kalman filter", "Planner (privileged)")
    assert set(cells) == set(PAPER) | {(row, column) for column in beside for row in CLASSES}
    for row, ids in CLASSES.items():
        cell = cells[row, "Kalman filter"]
        assert (cell.successes, cell.n, cell.paper) == (sum(2 + i % 3 for i in ids), 12 * len(ids), None)
        assert cell.status == "measured" and cell.runs == f"{TACTILE}-s0" and cell.steps_trained == "123456"
    for role, column in zip(BENCHMARK, columns, strict=True):
        for row, ids in CLASSES.items():
            cell = cells[row, column]
            count, total = sum(successes[role][i] for i in ids), 12 * len(ids)
            assert (cell.successes, cell.n) == (count, total)
            assert cell.ours == pytest.approx(count / total, abs=1e-6)
            assert (cell.low, cell.high) == pytest.approx(wilson(count, total), abs=1e-6)
            assert cell.paper == PAPER[row, column]
            assert cell.status == "measured" and cell.steps_trained == "123456"
            shown = [line[2 + ordered.index(column)] for line in rows_of(tex)[row]]
            assert shown == [
                f"{cell.ours:.2f}",
                f"[{cell.low:.2f}, {cell.high:.2f}]",
                f"{cell.paper:.2f}",
                str(total),
            ]
    assert tex.count("missing") == 6  # the finger cell and the planner


def test_a_missing_run_is_missing_and_never_a_number(world, tmp_path):
    for role in BENCHMARK[:3]:
        world.evaluated(
            role, "nominal", [row for i in range(13) for row in world.draw(role, THINGS[i], 6, 12)]
        )
    world.absent(BENCHMARK[3])
    cells, tex = tables(world, "table1", tmp_path)
    for (_, column), cell in cells.items():
        if column in ("Estimator Pos", "Finger cell", "Kalman filter", "Planner (privileged)"):
            assert (cell.status, cell.ours, cell.low, cell.high, cell.n) == ("missing", None, None, None, 0)
        else:
            assert cell.status == "measured"
    assert tex.count("missing") == 12
    with (tmp_path / "table1.csv").open(newline="") as file:
        assert [line["ours"] for line in csv.DictReader(file) if line["column"] == "Estimator Pos"] == [
            "",
            "",
            "",
        ]


def test_a_class_with_an_object_missing_is_missing(world, tmp_path):
    role = BENCHMARK[0]
    world.evaluated(role, "nominal", [row for i in range(12) for row in world.draw(role, THINGS[i], 6, 12)])
    cells, _ = tables(world, "table1", tmp_path)
    assert (
        cells["Round", "Oracle VecBPS"].status == "missing" and "[12]" in cells["Round", "Oracle VecBPS"].note
    )
    assert cells["Convex", "Oracle VecBPS"].status == "measured"


def test_seeds_are_pooled(world, tmp_path):
    role = BENCHMARK[0]
    for seed, successes in ((0, 12), (1, 6)):
        rows = [row for i in range(13) for row in world.draw(role, THINGS[i], successes, 12)]
        world.evaluated(role, "nominal", rows, seed)
    cells, _ = tables(world, "table1", tmp_path)
    assert cells["Round", "Oracle VecBPS"].ours == 0.75 and cells["Round", "Oracle VecBPS"].n == 48
    assert cells["Round", "Oracle VecBPS"].runs == f"{role}-s0 {role}-s1"


def test_table2_holds_relative_changes(world, tmp_path):
    world.evaluated(
        TACTILE, "nominal", [row for i in range(13) for row in world.draw(TACTILE, THINGS[i], 80, 100)]
    )
    kept = dict(zip(ABLATED.values(), (78, 79, 56, 80), strict=True))
    for role, successes in kept.items():
        world.evaluated(
            role, "nominal", [row for i in range(13) for row in world.draw(role, THINGS[i], successes, 100)]
        )
    cells, tex = tables(world, "table2", tmp_path)
    names = (
        "No sigma input to the policy",
        "Stop gradient through B",
        "No shape info",
        "BPS (distance only)",
    )
    paper = ((-0.026, 0.12), (-0.017, 0.05), (-0.30, 0.89), (0.0, -0.002))
    for name, (success, angle), successes in zip(names, paper, kept.values(), strict=True):
        cell = cells[name, "relative success rate"]
        assert cell.ours == pytest.approx(successes / 80 - 1, abs=1e-6) and cell.n == 1300
        assert cell.low < cell.ours < cell.high or cell.ours == pytest.approx(cell.low)
        assert cell.paper == success and cells[name, "relative final angle to goal"].paper == angle
    assert r"$-30.0\,\%$" in tex


def test_no_ratio_to_a_base_without_successes(world, tmp_path):
    for role in (TACTILE, ABLATED["no_shape"]):
        world.evaluated(
            role, "nominal", [row for i in range(13) for row in world.draw(role, THINGS[i], 0, 12)]
        )
    cells, tex = tables(world, "table2", tmp_path)
    cell = cells["No shape info", "relative success rate"]
    assert cell.status == "undefined" and cell.ours is None and "zero" in cell.note and "undefined" in tex
    assert cells["No shape info", "relative final angle to goal"].status == "measured"
    assert cells["No sigma input to the policy", "relative success rate"].status == "missing"


def test_no_ratio_between_agents_of_which_one_was_trained_longer(world, tmp_path):
    for role, successes in ((TACTILE, 8), (ABLATED["no_shape"], 2), (ABLATED["no_sigma"], 6)):
        world.evaluated(
            role, "nominal", [row for i in range(13) for row in world.draw(role, THINGS[i], successes, 12)]
        )
    world.run(TACTILE, steps=1_000_000)
    world.run(ABLATED["no_shape"], steps=600_000)
    world.run(ABLATED["no_sigma"], steps=700_000)
    cells, _ = tables(world, "table2", tmp_path)
    cell = cells["No shape info", "relative success rate"]
    assert cell.status == "undefined" and cell.ours is None
    assert "not trained alike" in cell.note and "600 k" in cell.note and "1 M" in cell.note
    assert cells["No sigma input to the policy", "relative success rate"].status == "measured"


def test_steps_before_the_estimator_do_not_make_up_for_those_with_it(world, tmp_path):
    """Both started from an oracle of 100 M steps: all in all alike, but one has hardly met its estimator."""
    for role, steps in ((TACTILE, 5_000_000), (ABLATED["no_shape"], 2_000_000)):
        world.evaluated(
            role, "nominal", [row for i in range(13) for row in world.draw(role, THINGS[i], 6, 12)]
        )
        name = world.run(role, steps=steps)
        file = world.folder / "agents" / name / "agent.json"
        file.write_text(
            json.dumps(json.loads(file.read_text()) | {"warm_start": {"from": "it", "steps": 10**8}})
        )
    cell = tables(world, "table2", tmp_path)[0]["No shape info", "relative success rate"]
    assert cell.status == "undefined" and "not trained alike with the estimator" in cell.note
