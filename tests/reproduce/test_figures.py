"""Figures: the same data give the same bytes, bars and cells hold the rates, and what is missing says so."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import object_sets
from reproduce.artefacts import make
from reproduce.artefacts.extent import polynomial, samples, smooth
from reproduce.artefacts.learning import band, ends
from reproduce.artefacts.violin import density_of
from reproduce.cells import read_cells
from reproduce.errors import ReproduceError
from reproduce.inventory import FINGERS, ORACLE, SENSITIVITY, TACTILE, TRANSFER, TRANSFERRED
from reproduce.plan import FIGURES, TABLES
from reproduce.results import Curve, read_curve
from reproduce.style import figure, missing_bar, say_missing
from tactile_kit.evaluation import wilson
from tactile_kit.evaluation.courses import Moment, write_courses

THINGS = {thing.id: thing for thing in object_sets.load("all")}


def outputs(name, folder):
    if name == "claims":
        return [folder / "claims.csv"]
    if name in TABLES:
        return [folder / "tables" / f"{name}.{suffix}" for suffix in ("csv", "tex")]
    return [folder / "figures" / f"{name}.{suffix}" for suffix in ("png", "svg", "csv")]


@pytest.mark.parametrize("name", [*FIGURES, *TABLES, "claims"])
def test_same_data_same_bytes(full_world, tmp_path, name):
    made = []
    for turn in ("a", "b"):
        files = outputs(name, tmp_path / turn)
        make(name, full_world.results, files)
        made.append([file.read_bytes() for file in files])
    assert made[0] == made[1]
    for file, content in zip(files, made[0], strict=True):
        if file.suffix == ".png":
            assert content.startswith(b"\x89PNG") and b"tIME" not in content and b"Matplotlib" not in content
        if file.suffix == ".svg":
            assert b"<svg" in content and b"dc:date" not in content


@pytest.mark.parametrize("name", [name for name in FIGURES if name != "object_sets"])
def test_a_world_without_runs_has_missing_cells_only(world, tmp_path, name):
    files = outputs(name, tmp_path)
    make(name, world.results, files)
    cells = read_cells(files[2])
    assert cells and all(cell.status == "missing" and cell.ours is None for cell in cells)
    assert (
        b"missing" in files[1].read_bytes() or name == "confusion"
    )  # text is drawn as paths; comments hold it


def test_bars_hold_rate_interval_and_count(world, tmp_path):
    world.evaluated(
        TACTILE, "nominal", [row for i in range(13) for row in world.draw(TACTILE, THINGS[i], i, 24)]
    )
    files = outputs("success", tmp_path)
    make("success", world.results, files)
    cells = read_cells(files[2])
    simulated = [cell for cell in cells if "simulation" in cell.column]
    transferred = [cell for cell in cells if "another" in cell.column]
    assert len(simulated) == len(transferred) == 13
    for item, cell in enumerate(simulated):
        assert cell.ours == pytest.approx(item / 24, abs=1e-6) and cell.n == 24
        assert (cell.low, cell.high) == pytest.approx(wilson(item, 24), abs=1e-6)
        assert cell.paper == (0.66 if item in (5, 12) else 0.90)
    assert all(cell.status == "missing" and cell.note == "not evaluated there" for cell in transferred)


def test_transferred_episodes_fill_their_bars(world, tmp_path):
    for evaluation, successes in (("nominal", 20), (TRANSFER, 12)):
        rows = [row for i in range(13) for row in world.draw(TACTILE, THINGS[i], successes, 24)]
        world.evaluated(TACTILE, evaluation, rows)
    files = outputs("success", tmp_path)
    make("success", world.results, files)
    assert {c.ours for c in read_cells(files[2]) if "another" in c.column} == {0.5}


def test_agents_stand_in_both_simulators_by_class(world, tmp_path):
    for role, here, there in zip(TRANSFERRED, (20, 16, 12), (18, 10, 6), strict=True):
        for evaluation, successes in (("nominal", here), (TRANSFER, there)):
            rows = [row for i in range(13) for row in world.draw(role, THINGS[i], successes, 24)]
            world.evaluated(role, evaluation, rows)
    files = outputs("transfer", tmp_path)
    make("transfer", world.results, files)
    cells = read_cells(files[2])
    assert [cell.row for cell in cells[:4]] == ["All", "Convex", "Round", "Non-convex"]
    assert [cell.n for cell in cells[:4]] == [13 * 24, 6 * 24, 2 * 24, 5 * 24]
    rates = [round(24 * cell.ours) for cell in cells if cell.row == "All"]
    assert rates == [20, 18, 16, 10, 12, 6]


def test_sensitivity_stands_beside_the_default(world, tmp_path):
    lines = []
    for condition, successes, error in (
        ("default", 12, 0.2),
        ("joint offset x 0", 18, 0.1),
        ("mass x 2", 6, 0.4),
    ):
        for number in range(24):
            theta = 0.2 if number < successes else 1.0
            wrong = error + 0.01 * (number // 2)
            thing = THINGS[number % 2]
            lines.append(
                Moment(
                    condition,
                    thing.id,
                    thing.name,
                    number,
                    number,
                    10.0,
                    theta,
                    theta,
                    wrong,
                    wrong,
                    0.01,
                    0.1,
                    "time",
                )
            )
    name = world.run(FINGERS)
    write_courses(tmp_path / "sensitivity.csv", lines)
    world.courses = {f"{name}/{SENSITIVITY}": str(tmp_path / "sensitivity.csv")}
    files = outputs("sensitivity", tmp_path)
    make("sensitivity", world.results, files)
    cells = {(cell.row, cell.column, cell.quantity): cell for cell in read_cells(files[2])}
    assert cells["default", "x 1", "success rate"].ours == 0.5
    assert cells["joint offset", "x 0", "success rate"].ours == 0.75
    assert cells["mass", "x 2", "success rate"].successes == 6
    error = cells["joint offset", "x 0", "mean error of the estimate (rad)"]
    assert error.ours == pytest.approx(0.155) and error.low < 0.155 < error.high
    assert cells["joint noise", "x 0", "success rate"].status == "missing"


def test_complex_compares_the_agents(world, tmp_path):
    for role, successes in ((ORACLE, 18), (TACTILE, 9)):
        world.evaluated(
            role, "complex", [row for i in (13, 14, 15) for row in world.draw(role, THINGS[i], successes, 24)]
        )
    files = outputs("complex", tmp_path)
    make("complex", world.results, files)
    assert [cell.ours for cell in read_cells(files[2])] == [0.75] * 3 + [0.375] * 3


def test_confusion_has_mesh_given_in_rows(world, tmp_path):
    rows = [
        row for given in range(13) for held in range(13)
        for row in world.draw(TACTILE, THINGS[held], 12 if given == held else given, 13, THINGS[given])
    ]  # fmt: skip
    world.evaluated(TACTILE, "confusion", rows)
    files = outputs("confusion", tmp_path)
    make("confusion", world.results, files)
    matrix = np.array([cell.successes for cell in read_cells(files[2])]).reshape(13, 13)
    expected = np.tile(np.arange(13)[:, None], (1, 13))
    np.fill_diagonal(expected, 12)
    np.testing.assert_array_equal(matrix, expected)


def test_violin_separates_drops_and_large_angles(world, tmp_path):
    rows = []
    for role in (ORACLE, TACTILE):
        found = world.draw(role, THINGS[8], 10, 16)
        found[12] = dataclasses.replace(found[12], drop=True, theta=0.1)  # dropped, whatever its angle
        found[10:12] = [
            dataclasses.replace(row, drop=False, theta=theta)
            for row, theta in zip(found[10:12], (1.49, 1.51), strict=True)
        ]
        found[13:] = [dataclasses.replace(row, drop=False, theta=0.9) for row in found[13:]]
        world.evaluated(role, "nominal", found)
        rows.append(found)
    files = outputs("violin", tmp_path)
    make("violin", world.results, files)
    shares = [c for c in read_cells(files[2]) if c.row == "8 cube" and c.quantity.startswith("share")]
    assert [(c.successes, c.n) for c in shares] == [(2, 16), (2, 16)]
    angles = [c.ours for c in read_cells(files[2]) if c.row == "8 cube" and "angle" in c.quantity]
    assert angles == pytest.approx([np.mean([row.theta for row in found]) for found in rows], abs=1e-5)


def test_density_holds_all_mass_above_zero():
    grid = np.linspace(0, 1.5, 1501)
    density = density_of(np.array([0.01, 0.02, 0.5, 1.0]), grid)
    assert np.trapezoid(density, grid) == pytest.approx(1.0, abs=1e-3)


def test_extent_samples_and_fit(world):
    rows = []
    extents = np.linspace(0.046, 0.089, 12)
    for size, extent in enumerate(extents, start=1):
        rows += world.draw(
            TACTILE, THINGS[8].with_extents((0.0675, 0.0675, extent)), size, 24, THINGS[8], size
        )
    x, rates, counts = samples(rows)
    np.testing.assert_allclose(x, extents)
    np.testing.assert_allclose(rates, np.arange(1, 13) / 24)
    assert set(counts) == {24}
    exact = 0.3 + 40 * (x - 0.06) ** 2
    np.testing.assert_allclose(polynomial(x, exact, 4)(x), exact, atol=1e-9)
    assert polynomial(x[:5], exact[:5], 4) is None  # five points fix a polynomial of degree 4; that is no fit


def test_a_smoother_says_nothing_where_there_is_nothing():
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(0.046, 0.055, 40), rng.uniform(0.077, 0.089, 40)])
    rates = np.where(x < 0.06, 0.2, 0.8) + rng.normal(0, 0.05, 80)
    left, right = smooth(x, rates, seed=0)
    assert left[0].max() < 0.062 and right[0].min() > 0.07  # nothing is drawn across the gap
    for (_, mean, low, high), level in ((left, 0.2), (right, 0.8)):
        assert (low <= mean).all() and (mean <= high).all() and (high - low < 0.1).all()
        np.testing.assert_allclose(mean, level, atol=0.05)
    assert smooth(x[:3], rates[:3], seed=0) == []
    again, _ = smooth(x, rates, seed=0)
    np.testing.assert_array_equal(again[2], left[2])


@pytest.mark.parametrize("sizes, fitted", [(24, 0), (256, 2)])
def test_a_curve_is_fitted_to_many_samples_only(world, tmp_path, monkeypatch, sizes, fitted):
    extents = np.linspace(0.0455, 0.0895, sizes)
    held = [THINGS[8].with_extents((0.0675, 0.0675, extent)) for extent in extents]
    for evaluation in ("extent-true", "extent-fixed"):
        rows = [r for i, thing in enumerate(held) for r in world.draw(TACTILE, thing, i % 3, 3, THINGS[8], i)]
        world.evaluated(TACTILE, evaluation, rows)
    drawn = []
    monkeypatch.setattr("reproduce.artefacts.extent.save", lambda made, _: drawn.append(made))
    make("extent", world.results, outputs("extent", tmp_path))
    assert sum(len(line.get_xdata()) == 200 for line in drawn[0].axes[0].lines) == fitted


def test_what_is_missing_draws_words_only():
    _, (panel, bars) = figure(4, 2, 2)
    say_missing(panel, "no run")
    missing_bar(bars, 0.0)
    assert not panel.axison and [text.get_text() for text in (*panel.texts, *bars.texts)] == [
        "no run",
        "missing",
    ]
    assert not bars.patches


def test_curves_are_cut_where_all_seeds_are():
    long = Curve("a", (0, 100, 200), (0.0, 0.5, 1.0))
    brief = Curve("b", (0, 100), (0.0, 0.3))
    steps, low, mean, high = band([long, brief])
    assert steps[-1] == 100
    np.testing.assert_allclose([low[-1], mean[-1], high[-1]], [0.3, 0.4, 0.5])
    np.testing.assert_allclose(ends([long, brief]), [0.475, 0.285])


@pytest.mark.parametrize(
    "line, word",
    [('{"step": 5, "success": 1.5}', "success"), ('{"step": -1, "success": 0.5}', "step"), ("{", "JSON")],
)
def test_bad_metrics_are_refused_with_file_and_line(tmp_path, line, word):
    path = tmp_path / "metrics.jsonl"
    path.write_text('{"step": 1, "success": 0.5}\n' + line + "\n")
    with pytest.raises(ReproduceError, match="line 2") as error:
        read_curve("run", path)
    assert str(path) in str(error.value) and word in str(error.value)


def test_a_curve_is_of_held_out_points_where_there_are_any(tmp_path):
    path = tmp_path / "metrics.jsonl"
    path.write_text(
        '{"step": 1, "success": 0.5}\n{"step": 2, "held_out/success": 0.9}\n{"step": 3, "success": 0.6}\n'
    )
    assert read_curve("run", path) == Curve("run", (2,), (0.9,))


def test_held_out_lines_are_no_training_points(tmp_path):
    path = tmp_path / "metrics.jsonl"
    path.write_text(
        '{"step": 1, "success": null}\n{"step": 2, "success": 0.5}\n'
        '{"step": 2, "evaluation": true, "success_rate": 0.9}\n'
    )
    assert read_curve("run", path) == Curve("run", (2,), (0.5,))
