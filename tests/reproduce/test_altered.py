"""Rows that were altered after their evaluation are refused; evaluations that no artefact reads are made as well."""

from __future__ import annotations

import json
import shutil
from hashlib import sha256
from pathlib import Path

import pytest

import object_sets
from reproduce.errors import ReproduceError
from reproduce.files import ROOT, dump_yaml, read_yaml
from reproduce.inventory import NEEDS, TACTILE
from reproduce.pipeline import _command, _wanted
from reproduce.plan import make_plan
from reproduce.prepare import prepare
from reproduce.results import Results
from reproduce.scales import load_scale


def test_rows_altered_after_their_evaluation_are_refused(tmp_path: Path, world) -> None:
    world.evaluated(TACTILE, "nominal", world.draw(TACTILE, object_sets.load("all")["cube"], 2, 4))
    name = f"{TACTILE}-s0/nominal"
    file = Path(world.episodes[name])
    marker = tmp_path / "evaluated" / f"{name}.json"
    marker.parent.mkdir(parents=True)
    marker.write_text(json.dumps({"digest": sha256(file.read_bytes()).hexdigest()}))
    content = {"runs": world.runs, "episodes": world.episodes}
    assert Results(content, tmp_path / "evaluated").rows(TACTILE, "nominal")
    text = file.read_text()
    file.write_text(text.replace(",0,1,", ",1,0,", 1))
    with pytest.raises(
        ReproduceError, match=rf"{file}: SHA-256 is .* it was altered; delete it and run again"
    ):
        Results(content, tmp_path / "evaluated").rows(TACTILE, "nominal")
    marker.unlink()  # rows that came with an agent have no marker
    file.write_text(text)
    assert Results(content, tmp_path / "evaluated").rows(TACTILE, "nominal")


@pytest.mark.slow
def test_an_evaluation_that_no_artefact_reads_is_made(tmp_path: Path) -> None:
    run = "oracle-pos-geometric8-s0"
    agents = tmp_path / "agents" / run
    agents.mkdir(parents=True)
    shutil.copy(ROOT / "results" / "agents" / run / "agent.json", agents)
    content = read_yaml(ROOT / "reproduce" / "scales" / "smoke.yaml")
    own = {"name": "complex", "runs": [run.removesuffix("-s0")], "objects": "complex", "goals_per_case": 1}
    content["evaluations"].append(own)
    (tmp_path / "own.yaml").write_text(dump_yaml(content))
    assert not any((own["runs"][0], "complex") in pairs for pairs, _ in NEEDS.values())
    plan = make_plan(
        load_scale(str(tmp_path / "own.yaml")), "pretrained", tmp_path / "out", tmp_path / "agents"
    )
    config = prepare(plan)
    wanted = _wanted(_command(plan, config, 1, None), config)
    assert f"evaluate/{run}/complex" in wanted and f"evaluate/{run}/nominal" in wanted
