"""`reproduce status`: what is there, what is missing for which table, and how long it would take."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from reproduce.cli import main
from reproduce.plan import make_plan
from reproduce.scales import load_scale
from reproduce.status import SPEED, sparkline, standing


def agent(folder: Path, name: str, steps: int, hours: float, curve: tuple[float, ...] = ()) -> None:
    directory = folder / name
    directory.mkdir(parents=True)
    manifest = {"steps": steps, "hours": hours, "warm_start": None}
    (directory / "agent.json").write_text(json.dumps(manifest))
    lines = [json.dumps({"step": 1000 * at, "success": rate}) for at, rate in enumerate(curve)]
    (directory / "metrics.jsonl").write_text("\n".join(lines))


def test_nothing_there(tmp_path: Path) -> None:
    found = standing(make_plan(load_scale("small"), "pretrained", tmp_path, tmp_path / "none"))
    assert not any(run["steps"] for run in found["runs"])
    one = {artefact["name"]: artefact for artefact in found["artefacts"]}
    assert len(one["learning"]["missing"]) == one["learning"]["of"] == 57
    assert one["learning"]["hours"] == pytest.approx(57 * 20e6 / SPEED, rel=0.01)
    assert "oracle-vec_bps-geometric8-s0" in one["table1"]["missing"]
    assert "oracle-vec_bps-geometric8-s0/nominal" in one["table1"]["episodes"]
    assert one["object_sets"] == {
        "name": "object_sets", "of": 0, "missing": [], "short": [], "episodes": [], "hours": 0.0,
    }  # fmt: skip


def test_what_is_there_counts_and_tells_the_speed(tmp_path: Path) -> None:
    agents = tmp_path / "agents"
    agent(agents, "oracle-vec_bps-cube-s1", 20_000_000, 2.0, (0.0, 0.5, 1.0))  # whole: 10 M steps an hour
    agent(agents, "oracle-vec_bps-cube-s2", 5_000_000, 1.0)  # a quarter of the scale's, and slower
    found = standing(make_plan(load_scale("small"), "pretrained", tmp_path, agents))
    runs = {run["name"]: run for run in found["runs"]}
    assert runs["oracle-vec_bps-cube-s1"]["hours_to_go"] == 0
    assert runs["oracle-vec_bps-cube-s2"]["hours_to_go"] == pytest.approx(1.5)
    assert runs["oracle-vec_bps-cube-s3"]["hours_to_go"] == pytest.approx(2.0)
    learning = next(one for one in found["artefacts"] if one["name"] == "learning")
    assert len(learning["missing"]) == 55 and learning["short"] == ["oracle-vec_bps-cube-s2"]
    assert learning["hours"] == pytest.approx(1.5 + 55 * 2.0)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    agents = tmp_path / "agents"
    agent(agents, "oracle-vec_bps-cube-s1", 20_000_000, 2.0, (0.0, 0.5, 1.0))
    (agents / "oracle-vec_bps-cube-s1" / ".lock").write_text("process 7 on here")
    arguments = ["status", "--agents", str(agents), "--out", str(tmp_path)]
    assert main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    line = next(line for line in lines if line.startswith("oracle-vec_bps-cube-s1"))
    assert line.split()[1:9] == ["20", "M", "20", "M", "2.00", "1.00", "▁▅█", "process"]
    assert any(line.startswith("object_sets  complete") for line in lines)
    assert main([*arguments, "--json"]) == 0
    assert {run["name"] for run in json.loads(capsys.readouterr().out)["runs"]} > {"oracle-vec_bps-cube-s1"}


def test_sparklines() -> None:
    assert sparkline([]) == "" and sparkline([0.0, 0.49, 1.0]) == "▁▄█"
    assert sparkline([0.0] * 50 + [1.0] * 50, 4) == "▁▁██"
