"""The README's results are the tables', and say what is missing."""

from pathlib import Path

import pytest

from reproduce.errors import ReproduceError
from reproduce.readme import BEGIN, END, LEAD_BEGIN, LEAD_END, block, lead, write

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
    readme.write_text(f"before\n{LEAD_BEGIN}\nold\n{LEAD_END}\n{BEGIN}\nold\n{END}\nafter\n")
    write(readme, results)
    text = readme.read_text()
    assert text.startswith("before\n") and text.endswith("\nafter\n") and "old" not in text
    write(readme, results)
    assert readme.read_text() == text


def test_the_lead_has_the_rate_over_all_and_the_hours_of_the_whole_chain(results: Path):
    line = "{},{},success rate,{},{},0.9,1,24,episodes,{},measured,,{},1\n"
    rows = [
        line.format(row, column, paper, hits / 24, hits, run)
        for row, column, paper, hits, run in (
            ("Round", "Oracle VecBPS", 0.97, 24, "o"),
            ("Round", "Estimator VecBPS", 0.66, 6, "t"),
            ("Round", "Finger cell", "", 18, "f"),
            ("Convex", "Oracle VecBPS", 0.97, 24, "o"),
            ("Convex", "Estimator VecBPS", 0.90, 6, "t"),
            ("Convex", "Finger cell", "", 12, "f"),
        )
    ]
    (results / "tables" / "table1.csv").write_text(HEADER + "".join(rows))
    (results / "agents" / "f").mkdir(parents=True)
    (results / "agents" / "f" / "agent.json").write_text('{"hours": 0.5, "warm_start": {"hours": 2.0}}')
    text = lead(results)
    assert "in 62 % of 48 episodes (the paper's: 66 to 90 %" in text
    assert "(VecBPS) reach the paper's rates" in text and "2.5 hours on two CPU cores" in text


def test_without_a_tactile_agent_the_lead_says_so(results: Path):
    assert "No agent that only feels" in lead(results)


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
