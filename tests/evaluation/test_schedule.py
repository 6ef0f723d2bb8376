"""Which objects an evaluation has: those that can be held."""

import pickle

import pytest
import trimesh

import object_sets
from reproduce.cli import main
from tactile_kit.errors import EvaluationError
from tactile_kit.evaluation import schedule as module
from tactile_kit.evaluation.schedule import schedule
from tactile_kit.simulation.grasps import GraspError
from tactile_kit.task.config import TaskConfig


@pytest.fixture
def speck(tmp_path, monkeypatch):
    """A set with a cube of 6 mm, which falls between the fingers, and a box of the usual size."""
    monkeypatch.setattr(module, "GRASPS", 1)
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((0.006, 0.006, 0.006)).export(tmp_path / "meshes" / "speck.stl")
    trimesh.creation.box((0.06, 0.06, 0.06)).export(tmp_path / "meshes" / "die.stl")
    return object_sets.build(tmp_path / "my_set", meshes=tmp_path / "meshes").parent


def test_what_cannot_be_held_costs_its_own_rows(speck, caplog):
    plan = schedule(TaskConfig(encoding="none"), [speck, "cube"], goals_per_case=2)
    assert [plan.variants.objects[case.held].name for case in plan.cases] == ["die", "cube"]
    assert len(plan.episodes) == 4
    assert "left out of the evaluation: speck with extents [6. 6. 6.] mm: 0 of 1 grasps held" in caplog.text
    with pytest.raises(EvaluationError, match="nothing can be evaluated: speck") as caught:
        schedule(TaskConfig(encoding="none"), f"{speck}/speck", goals_per_case=2)
    assert isinstance(caught.value.__cause__, GraspError)
    assert pickle.loads(pickle.dumps(caught.value.__cause__)).thing == "speck"


def test_an_output_that_cannot_be_written_is_found_first(tmp_path, capsys):
    (tmp_path / "agent.json").write_text("{}")
    for command in (
        ["evaluate", "--agent", str(tmp_path)],
        ["evaluate-planner"],
        ["film", "--agent", str(tmp_path)],
    ):
        for out in ("/proc/nowhere/rows.csv", str(tmp_path)):
            assert main([*command, "--out", out]) == 2
            assert f"reproduce: --out {out.removesuffix('/rows.csv')}: " in capsys.readouterr().err
