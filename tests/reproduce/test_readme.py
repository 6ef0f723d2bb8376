"""The README's results are the tables', and say what is missing."""

from pathlib import Path

import pytest

from reproduce.errors import ReproduceError
from reproduce.readme import BEGIN, END, block, write

HEADER = "row,column,quantity,paper,ours,low,high,n,unit,successes,status,note,runs,steps_trained\n"
TABLE = (
    HEADER
    + "Round,Oracle,success rate,0.99,0.5,0.25,0.75,24,episodes,12,measured,,a,250000\n"
    + "Round,Tactile,success rate,0.66,,,,0,episodes,,missing,not trained,,\n"
)
CLAIMS = "number,claim,verdict,ours,paper,n,unit,scale\n1,A,reproduced,,,1,,s\n2,B,not measured,,,0,,s\n"


@pytest.fixture
def results(tmp_path: Path) -> Path:
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "table1.csv").write_text(TABLE)
    (tmp_path / "claims.csv").write_text(CLAIMS)
    return tmp_path


def test_block_shows_values_intervals_and_gaps(results: Path):
    text = block(results)
    assert "| Round | **0.50** [0.25, 0.75] (paper 0.99) | missing (paper 0.66) |" in text
    assert "| trained for | 250 k steps | missing |" in text
    assert "2 claims: 1 reproduced, 1 not measured" in text


def test_only_the_block_is_replaced(results: Path, tmp_path: Path):
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    write(readme, results)
    text = readme.read_text()
    assert text.startswith("before\n") and text.endswith("\nafter\n") and "old" not in text
    write(readme, results)
    assert readme.read_text() == text


def test_missing_markers_and_tables_are_named(results: Path, tmp_path: Path):
    readme = tmp_path / "README.md"
    readme.write_text("nothing here")
    with pytest.raises(ReproduceError, match=r"README\.md"):
        write(readme, results)
    with pytest.raises(ReproduceError, match="make reproduce"):
        block(tmp_path / "elsewhere")


def test_committed_readme_is_up_to_date(tmp_path: Path):
    root = Path(__file__).parents[2]
    copy = tmp_path / "README.md"
    copy.write_text((root / "README.md").read_text())
    write(copy, root / "results")
    assert copy.read_text() == (root / "README.md").read_text(), "run `make docs`"
