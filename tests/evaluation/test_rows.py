"""Episode files: what is written comes back, the same rows give the same bytes, and what is out of range is refused."""

from __future__ import annotations

import dataclasses

import pytest

from tactile_kit.evaluation import COLUMNS, EpisodeFileError, EpisodeRow, read_rows, write_rows

ROW = EpisodeRow(
    "tactile-vec_bps-geometric8-s0", "tactile", "vec_bps", 0, 8, "cube", 0, 0.0675, 0.0675, 0.0675, 9, "cuboid",
    0.08, 0.08, 0.05, 23, 1, (1 << 63) - 1, 0.25, 0.125, True, False, "", 100,
)  # fmt: skip
FAULT = dataclasses.replace(
    ROW, theta=None, theta_min=None, success=False, fault="position is NaN", goal=-1, steps=3
)


def test_rows_come_back(tmp_path):
    path = write_rows(tmp_path / "deep" / "rows.csv", [ROW, FAULT])
    assert read_rows(path) == [ROW, FAULT]


def test_same_rows_same_bytes(tmp_path):
    first = write_rows(tmp_path / "a.csv", [ROW, FAULT]).read_bytes()
    assert write_rows(tmp_path / "b.csv", read_rows(tmp_path / "a.csv")).read_bytes() == first
    assert first.splitlines()[0].decode() == ",".join(COLUMNS)


@pytest.mark.parametrize(
    "column, value, allowed",
    [
        ("theta", 3.2, "[0, 3.14"),
        ("theta", float("nan"), "[0, 3.14"),
        ("goal", 24, "<= 23"),
        ("kind", "human", "oracle, tactile or planner"),
        ("extent_y", 0.0, "0.001"),
        ("extent_y", 6.75, "0.5"),
        ("object", "", "non-empty"),
        ("steps", -1, ">= 0"),
        ("seed", 1 << 63, "<="),
    ],
)
def test_values_out_of_range_are_refused_with_file_line_and_range(tmp_path, column, value, allowed):
    path = tmp_path / "rows.csv"
    with pytest.raises(EpisodeFileError) as error:
        write_rows(path, [ROW, dataclasses.replace(ROW, **{column: value})])
    message = str(error.value)
    assert str(path) in message and "line 3" in message and column in message and allowed in message
    assert not list(tmp_path.iterdir())  # neither the file nor half of one


@pytest.mark.parametrize(
    "changes", [{"drop": True}, {"theta": 0.41}, {"fault": "x"}, {"success": False, "theta": None}]
)
def test_rows_that_contradict_themselves_are_refused(tmp_path, changes):
    with pytest.raises(EpisodeFileError, match="allowed only"):
        write_rows(tmp_path / "rows.csv", [dataclasses.replace(ROW, **changes)])


def test_an_episode_that_comes_twice_is_refused_by_line(tmp_path):
    """Six episodes ten times over are six: n = 60 would narrow the interval."""
    others = [dataclasses.replace(ROW, episode=number) for number in range(5)]
    path = write_rows(tmp_path / "rows.csv", others)
    header, *lines = path.read_text().splitlines()
    path.write_text("\n".join([header, *lines * 10]) + "\n")
    with pytest.raises(
        EpisodeFileError, match=r"rows\.csv, line 7: the episode of line 2 again \(cube, size 0"
    ):
        read_rows(path)
    worse = dataclasses.replace(others[3], theta=3.0, theta_min=1.0, success=False)
    with pytest.raises(EpisodeFileError, match=r"line 7: the episode of line 5 again"):
        write_rows(tmp_path / "other.csv", [*others, worse])
    assert not (tmp_path / "other.csv").exists()


def test_folders_and_bytes_are_refused_by_name(tmp_path):
    with pytest.raises(EpisodeFileError, match=f"{tmp_path}: Is a directory"):
        read_rows(tmp_path)
    (tmp_path / "rows.csv").write_bytes(b"\xff\xfe")
    with pytest.raises(EpisodeFileError, match=r"rows\.csv: no text in UTF-8"):
        read_rows(tmp_path / "rows.csv")


def test_an_angle_just_below_the_threshold_survives_rounding(tmp_path):
    row = dataclasses.replace(ROW, theta=0.4 - 1e-12)
    assert read_rows(write_rows(tmp_path / "rows.csv", [row]))[0].success


@pytest.mark.parametrize(
    "text", ["", "agent,kind\n", ",".join(COLUMNS) + "\n", ",".join(COLUMNS) + "\na,b\n"]
)
def test_malformed_files_are_refused_by_name(tmp_path, text):
    path = tmp_path / "rows.csv"
    path.write_text(text)
    with pytest.raises(EpisodeFileError, match=str(path)):
        read_rows(path)


def test_the_world_is_kept_and_older_files_are_bullets(tmp_path):
    rows = [dataclasses.replace(ROW, world="mujoco", goal=ROW.goal - 1), ROW]
    path = write_rows(tmp_path / "rows.csv", rows)
    assert [row.world for row in read_rows(path)] == ["mujoco", "bullet"]
    older = "\n".join(line.rpartition(",")[0] for line in path.read_text().splitlines())
    path.write_text(older + "\n")
    assert [row.world for row in read_rows(path)] == ["bullet", "bullet"]


def test_missing_files_are_refused_by_name(tmp_path):
    with pytest.raises(EpisodeFileError, match=r"nowhere\.csv"):
        read_rows(tmp_path / "nowhere.csv")


@pytest.mark.parametrize(
    "extents, furthest", [((0.06, 0.07, 0.08), 0.08), ((0.05, 0.07, 0.08), 0.05), ((0.0675,) * 3, 0.0675)]
)
def test_furthest_extent(extents, furthest):
    row = dataclasses.replace(ROW, extent_x=extents[0], extent_y=extents[1], extent_z=extents[2])
    assert row.furthest_extent == furthest
