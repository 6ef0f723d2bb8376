"""Artefacts of courses: what they say is what the lines say, in closed form."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import object_sets
from reproduce.artefacts import make
from reproduce.cells import read_cells
from reproduce.courses import FOLLOWING, OWN, TELLING, TRUTH, condition
from reproduce.inventory import COURSE, FINGERS, KALMAN, ORACLE, SIDE_BY_SIDE, TACTILE
from reproduce.tracks import Track, means, median, tracks
from tactile_kit.evaluation import wilson
from tactile_kit.evaluation.courses import MOMENTS, Moment, write_courses

THINGS = {thing.id: thing for thing in object_sets.load("all")}


def course(name, item, number, *, start=3.0, error=0.0, sigma=0.0, arrives=None, end="time", symmetric=None):
    """An episode whose error grows linearly to ``error`` at 10 s; at the goal from ``arrives`` s on; drops at 2.5 s."""
    lines = []
    for time in sorted({0.0, *MOMENTS, *([arrives] if arrives else []), *([2.5] if end != "time" else [])}):
        if end != "time" and time > 2.5:
            break
        last = time == (10.0 if end == "time" else 2.5)
        if not last and time == 2.5 and end != "time":
            continue
        theta = 0.2 if arrives is not None and time >= arrives else 2.0 if time else start
        off = error * time / 10
        lines.append(
            Moment(
                name, item, THINGS[item].name, 3, number, time, theta, theta, off, off / 2, 0.01, sigma,
                end if last else "", off if symmetric is None else symmetric,
            )
        )  # fmt: skip
    return lines


def kept(world, tmp_path, role, name, lines):
    run = f"{role}-s0"
    if run not in world.runs:
        world.run(role)
    write_courses(tmp_path / f"{run}-{name}.csv", lines)
    world.courses[f"{run}/{name}"] = str(tmp_path / f"{run}-{name}.csv")
    return run


def cells_of(world, tmp_path, name):
    files = [
        tmp_path / f"{name}.{suffix}"
        for suffix in (("csv", "tex") if name == "estimators" else ("png", "svg", "csv"))
    ]
    make(name, world.results, files)
    return {
        (c.row, c.column, c.quantity): c for c in read_cells(next(f for f in files if f.suffix == ".csv"))
    }


def test_a_drop_is_no_arrival_and_its_moment_counts_for_nothing():
    (track,) = tracks(course(OWN, 8, 0, arrives=2.5, end="drop"))[OWN]
    assert track.arrived == math.inf and track.last.theta == 0.2
    assert np.isnan(track.values("theta")).sum() == sum(moment > 2 for moment in MOMENTS)
    (track,) = tracks(course(OWN, 8, 0, arrives=1.4))[OWN]
    assert track.arrived == 1.4 and isinstance(track, Track)


def test_means_leave_out_what_is_over():
    parts = tracks([*course(OWN, 8, 0, error=1.0), *course(OWN, 8, 1, error=3.0, end="drop")])[OWN]
    found = means(parts, lambda track: track.values("error"), 0)
    assert found[0].value == pytest.approx(0.1) and found[0].n == 2
    assert found[-1].value == pytest.approx(1.0) and found[-1].n == 1


def test_medians_count_those_that_never_arrive():
    assert median([1.0, 2.0, math.inf]).value == 2.0
    assert median([1.0, math.inf, math.inf]) is None and median([]) is None
    many = median([float(i) for i in range(1, 101)])
    assert many.value == 50.5 and (many.low, many.high) == (
        40.0,
        61.0,
    )  # ranks 40 and 61 of 100, the sign test's
    assert median([1.0] * 5).low is None and median([1.0] * 6).low == 1.0
    assert median([1.0] * 51 + [math.inf] * 49).high is None


def test_estimators_stand_side_by_side(world, tmp_path):
    cell, fingers = world.run(TACTILE), world.run(FINGERS)
    lines = [line for n in range(10) for line in course(TRUTH, n % 2, n)]
    for name, error, sigma in (
        (cell, 1.0, 0.5),
        (fingers, 0.3, 0.1),
        ("kalman", 2.0, 0.5),
        ("rest", 2.0, 1.0),
    ):
        for n in range(10):
            lines += course(condition(name, FOLLOWING), n % 2, n, error=error, sigma=sigma)
        for n in range(10):
            drop = "drop" if n >= 6 else "time"
            lines += course(condition(name, TELLING), n % 2, n, arrives=5.0 if n < 4 else None, end=drop)
    run = kept(world, tmp_path, ORACLE, SIDE_BY_SIDE, lines)
    (tmp_path / "cost.json").write_text(
        json.dumps(
            {
                "costs": {
                    cell: {
                        name: {"environments": n, "median": 90.0, "low": 80.0, "high": 99.0, "calls": 100}
                        for name, n in (("alone", 1), ("together", 52))
                    }
                }
            }
        )
    )
    world.costs[f"{run}/{SIDE_BY_SIDE}"] = str(tmp_path / "cost.json")
    world.evaluated(TACTILE, "nominal", world.draw(TACTILE, THINGS[8], 6, 8))
    world.evaluated(TACTILE, KALMAN, world.draw(TACTILE, THINGS[8], 1, 8))
    cells = cells_of(world, tmp_path, "estimators")
    assert cells["Paper's cell", "error at 5 s", "mean error (rad)"].ours == pytest.approx(0.5)
    assert cells["Finger cell", "within 0.4 rad at 10 s", "share"].successes == 10
    assert cells["Paper's cell", "within 0.4 rad at 10 s", "share"].successes == 0
    spread = math.sqrt(np.mean((np.array(MOMENTS) / 10 * 1.0 / 0.5) ** 2))
    assert cells["Paper's cell", "error / sigma", "root mean square"].ours == pytest.approx(spread, rel=1e-4)
    told = cells["Kalman filter", "success, oracle's policy", "success rate"]
    assert (told.successes, told.n, told.note) == (4, 10, "4 dropped")
    assert (told.low, told.high) == pytest.approx(wilson(4, 10), abs=1e-5)
    tactile = {row: cell for (row, column, _), cell in cells.items() if column == "success, tactile policy"}
    assert (tactile["Paper's cell"].ours, tactile["Kalman filter"].ours) == (0.75, 0.125)
    assert tactile["Finger cell"].status == "missing" and tactile["R0 for ever"].status == "undefined"
    assert cells["Paper's cell", "a step alone", "CPU time (µs)"].ours == 90
    assert cells["Kalman filter", "a step alone", "CPU time (µs)"].status == "missing"
    drift = cells_of(world, tmp_path, "following")
    assert drift["Non-convex", "Paper's cell, 10 s", "mean error (rad)"].ours == pytest.approx(1.0)
    assert (
        drift["Round", "Paper's cell, 10 s", "mean error (rad)"].status == "missing"
    )  # no such object was played
    rest = [
        cell
        for (row, column, _), cell in drift.items()
        if column == "R0 for ever" and row.startswith("sigma")
    ]
    assert len(rest) == 1 and rest[0].row == "sigma 1.00 rad"
    assert rest[0].ours == pytest.approx(math.sqrt(np.mean((np.array(MOMENTS) / 10 * 2.0) ** 2)), rel=1e-4)


def test_speed_is_told_by_goal_distance(world, tmp_path):
    lines = []
    for n in range(10):
        lines += course(
            OWN, 8, n, arrives=(2.1, 3.5)[n % 2] if n < 8 else None, end="time" if n < 9 else "drop"
        )
    for n in range(4):
        lines += course(OWN, 0, n, start=1.5, arrives=1.2 if n == 0 else None)
    kept(world, tmp_path, ORACLE, COURSE, lines)
    cells = cells_of(world, tmp_path, "turning")
    time = cells["135 to 180 degrees", "Oracle VecBPS", "time to 0.4 rad, median (s)"]
    assert time.ours == 3.5 and time.n == 10
    assert cells["135 to 180 degrees, cube", "Oracle VecBPS", "share within 0.4 rad by 2.5 s"].successes == 4
    assert cells["135 to 180 degrees", "Oracle VecBPS", "share ever within 0.4 rad"].successes == 8
    never = cells["0 to 90 degrees", "Oracle VecBPS", "time to 0.4 rad, median (s)"]
    assert never.status == "undefined" and never.n == 4
    assert cells["90 to 135 degrees", "Oracle VecBPS", "share ever within 0.4 rad"].status == "missing"


def test_failures_are_counted_by_kind(world, tmp_path):
    lines = []
    for n in range(4):
        lines += course(OWN, 8, n, arrives=3.0)  # successes
    for n in range(4, 10):
        lines += course(OWN, 8, n, end="drop")
    for n in range(10, 13):
        lines += course(OWN, 8, n, error=1.5, symmetric=0.1)
    lines += course(OWN, 8, 13, error=1.0, symmetric=0.8)
    for n in range(14, 16):
        lines += course(OWN, 8, n, error=0.2)
    kept(world, tmp_path, FINGERS, COURSE, lines)
    cells = cells_of(world, tmp_path, "failures")
    counts = [
        cells[FINGERS, kind, "share of failures"].successes
        for kind in ("dropped", "lost estimate", "wrong symmetry", "stalled")
    ]
    assert counts == [6, 1, 3, 2] and cells[FINGERS, "dropped", "share of failures"].n == 12
    plain = cells[FINGERS, "cube", "error at 10 s (rad)"]
    assert plain.n == 10 and plain.ours == pytest.approx((3 * 1.5 + 1.0 + 2 * 0.2) / 10)
    assert cells[FINGERS, "cube", "error at 10 s up to symmetry (rad)"].ours == pytest.approx(
        (3 * 0.1 + 0.8 + 2 * 0.2) / 10, abs=1e-6
    )
    assert cells[TACTILE, "dropped", "share of failures"].status == "missing"
