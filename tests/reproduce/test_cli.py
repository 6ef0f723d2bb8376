"""The command: quick help, errors in one line, the contract of `evaluate`."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

from reproduce.cli import main
from reproduce.files import ROOT


@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["run", "--help"],
        ["stage", "--help"],
        ["train", "--help"],
        ["evaluate", "--help"],
        ["evaluate-planner", "--help"],
        ["train-estimator", "--help"],
        ["measure-estimator", "--help"],
        ["film", "--help"],
        ["view", "--help"],
        ["status", "--help"],
    ],
)
def test_help_needs_nothing_heavy(arguments):
    code = (
        "import sys\nfrom reproduce.cli import main\n"
        f"try: main({arguments!r})\nexcept SystemExit as end: assert end.code == 0\n"
        "heavy = {'torch', 'pybullet', 'matplotlib', 'coacd', 'snakemake', 'numpy'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    began = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert arguments[0] == "--help" or arguments[0] in done.stdout
    assert time.monotonic() - began < 10


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["trian", "--help"], ["trian", "'train'"]),
        (["run", "--scale", "smol"], ["smol", "smoke"]),
        (["run", "--jobs", "0"], ["--jobs 0", ">= 1"]),
        (["stage", "tabel1", "--scale", "smoke"], ["tabel1", "table1"]),
        (["evaluate", "--agent", "no/where", "--out", "x.csv"], ["no/where", "agent.json"]),
        (["train", "no/where.yaml", "--out", "x"], ["no/where.yaml"]),
        (["train-estimator", "--agent", "no/where", "--out", "x"], ["no/where", "agent.json"]),
    ],
)
def test_mistakes_end_with_one_line(arguments, words, capsys, tmp_path, monkeypatch):
    if arguments[0] in ("run", "stage"):
        arguments = [*arguments, "--out", str(tmp_path)]
    assert main(arguments) == 2
    said = capsys.readouterr().err.strip()
    assert "\n" not in said and all(word in said for word in words), said


def test_a_stage_runs_by_hand(tmp_path):
    assert (
        main(
            [
                "stage",
                "table1",
                "--scale",
                "smoke",
                "--out",
                str(tmp_path),
                "--agents",
                str(tmp_path / "none"),
            ]
        )
        == 0
    )
    assert (tmp_path / "tables" / "table1.tex").read_text().count("missing") == 21
    assert (
        main(
            [
                "stage",
                "evaluate",
                "a/b",
                "--scale",
                "smoke",
                "--out",
                str(tmp_path),
                "--agents",
                str(tmp_path / "none"),
            ]
        )
        == 2
    )
