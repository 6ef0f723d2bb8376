"""Files of courses: kept as they are, refused where malformed."""

from __future__ import annotations

import dataclasses

import pytest

from tactile_kit.errors import EpisodeFileError
from tactile_kit.evaluation.courses import COLUMNS, Moment, read_courses, write_courses

LINE = Moment("default", 8, "cube", 3, 77, 10.0, 0.25, 0.125, 0.5, 0.25, 0.004, 0.2, "time", 0.375)


def test_lines_are_kept_and_the_same_lines_give_the_same_bytes(tmp_path):
    lines = [
        dataclasses.replace(LINE, time=1.0, end=""),
        LINE,
        dataclasses.replace(LINE, goal=4, theta=0.5, end="drop"),
    ]
    for name in ("a.csv", "b.csv"):
        write_courses(tmp_path / name, lines)
    assert read_courses(tmp_path / "a.csv") == lines
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_only_who_stays_in_the_hand_at_the_goal_succeeds():
    assert LINE.success
    assert not dataclasses.replace(LINE, end="drop").success
    assert not dataclasses.replace(LINE, end="").success
    assert not dataclasses.replace(LINE, theta=0.41).success


@pytest.mark.parametrize(
    "change, said",
    [
        ({"theta": "nan"}, "theta = 'nan'"),
        ({"goal": "x"}, "goal = 'x'"),
        ({"end": "lost"}, "end = 'lost'"),
    ],
)
def test_malformed_lines_are_refused_by_name(tmp_path, change, said):
    path = tmp_path / "courses.csv"
    write_courses(path, [LINE])
    header, line = path.read_text().splitlines()
    cells = dict(zip(COLUMNS, line.split(","), strict=True)) | change
    path.write_text(header + "\n" + ",".join(cells.values()) + "\n")
    with pytest.raises(EpisodeFileError, match=said):
        read_courses(path)


def test_a_moment_that_comes_twice_is_refused(tmp_path):
    write_courses(tmp_path / "courses.csv", [LINE, dataclasses.replace(LINE, seed=78), LINE])
    with pytest.raises(EpisodeFileError, match=r"courses\.csv, line 4: the moment of line 2 again"):
        read_courses(tmp_path / "courses.csv")


def test_other_files_are_refused(tmp_path):
    with pytest.raises(EpisodeFileError, match="Is a directory"):
        read_courses(tmp_path)
    with pytest.raises(EpisodeFileError, match="no such file"):
        read_courses(tmp_path / "nowhere.csv")
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(EpisodeFileError, match="line 1"):
        read_courses(tmp_path / "other.csv")


def test_files_written_before_errors_up_to_symmetry_are_read(tmp_path):
    path = tmp_path / "courses.csv"
    write_courses(path, [LINE])
    header, line = (text.rsplit(",", 1)[0] for text in path.read_text().splitlines())
    path.write_text(f"{header}\n{line}\n")
    (before,) = read_courses(path)
    assert before == dataclasses.replace(LINE, symmetric=None)
    other = dataclasses.replace(LINE, goal=LINE.goal + 1)
    write_courses(path, [before, other])
    assert read_courses(path) == [before, other]
