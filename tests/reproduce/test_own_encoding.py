"""An encoding from a file outside the package, registered by one line, is trained, coupled, evaluated and plotted."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path

import pytest

from reproduce.cells import read_cells
from reproduce.cli import main
from reproduce.errors import ScaleError
from reproduce.files import dump_yaml
from reproduce.scales import parse_scale
from tactile_kit.agents import load_agent
from tactile_kit.evaluation import read_rows
from tactile_kit.shape import registry

REACH = textwrap.dedent('''\
    """The position, and how far the object stands out from its centre of mass."""

    import torch

    from tactile_kit.shape import Encoding


    class Reach(Encoding):
        name, label, size, observation_size = "reach", "Reach", 4, 4

        def __init__(self, meshes):
            super().__init__(meshes)
            far = [abs(meshes.triangles(i)).max() for i in range(len(meshes))]
            self._far = torch.tensor(far, dtype=torch.float64)

        def __call__(self, x, R, mesh):
            return torch.cat([x, self._far[mesh, None].to(x.dtype)], dim=1)
    ''')

LAYERS = {"hidden": [16]}
SMALL = {
    "steps": 512,
    "num_envs": 16,
    "num_workers": 1,
    "log_every": 128,
    "task": {"horizon": 12, "grasps": 2},
    "episodes": {"grasps": 2, "grasp_spread": 0.0},
    "evaluation": {"minutes": 0},
    "ppo": {"rollout": 8, "minibatch": 64, "actor": LAYERS, "critic": LAYERS},
}
COUPLED = {
    **SMALL,
    "preset": "tactile-compiled",
    "ppo": SMALL["ppo"] | {"fixed_steps": 0},
    "estimator": {"cell": "paper", "loss": "likelihood", "minibatch": 4}
    | {key: [16] for key in ("encoder_hidden", "transition_hidden", "sigma_hidden")},
    "ecrl": {"rollout": 4},
}
SCALE = {
    "name": "own",
    "description": "An encoding of one's own.",
    "num_envs": 2,
    "presets": {"oracle": {**SMALL, "preset": "ppo-compiled"}, "tactile": COUPLED},
    "runs": [
        {"kind": "oracle", "variants": ["reach"], "sets": ["cube"], "preset": "oracle"},
        {"kind": "tactile", "variants": ["reach"], "sets": ["cube"], "preset": "tactile",
         "warm_start": "oracle-{encoding}-{set}-s{seed}"},
    ],
    "evaluations": [{"name": "nominal", "runs": ["tactile-reach-cube"], "objects": "cube", "goals_per_case": 1}],
}  # fmt: skip


def install(folder: Path, value: str = "own_reach:Reach", name: str = "reach") -> None:
    """What pip leaves of a package whose setup.cfg has that one entry point."""
    about = folder / "own_reach-1.0.dist-info"
    about.mkdir(exist_ok=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: own-reach\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[{registry.GROUP}]\n{name} = {value}\n")
    (folder / "own_reach.py").write_text(REACH)


@pytest.mark.slow
def test_an_encoding_of_ones_own_goes_through_the_pipeline(tmp_path, monkeypatch):
    install(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    scale = tmp_path / "own.yaml"
    scale.write_text(dump_yaml(SCALE))
    asked = ["--scale", str(scale), "--from", "scratch", "--out", str(tmp_path / "out")]
    for stage in ("objects", "grasps", "train", "evaluate", "learning"):
        assert main(["stage", stage, *asked]) == 0
    oracle, tactile = (
        load_agent(tmp_path / "out/agents" / f"{kind}-reach-cube-s0") for kind in ("oracle", "tactile")
    )
    assert dict(oracle.manifest.layout) == {"joints": 144, "goal": 6, "shape": 4, "pose": 9}
    assert dict(tactile.manifest.layout) == {"joints": 144, "goal": 6, "shape": 4, "pose": 9, "sigma": 2}
    assert tactile.estimator.shape.name == "reach"
    (row,) = read_rows(tmp_path / "out/episodes/tactile-reach-cube-s0/nominal.csv")
    assert row.encoding == "reach"
    cells = {(cell.row, cell.column): cell for cell in read_cells(tmp_path / "out/figures/learning.csv")}
    assert cells["cube", "Reach"].status != "missing" and cells["cube", "VecBPS"].status == "missing"
    assert json.loads((tmp_path / "out/.pipeline/plan.json").read_text())["train"].keys() == {
        "oracle-reach-cube-s0",
        "tactile-reach-cube-s0",
    }


def test_what_can_not_be_loaded_is_named(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(ScaleError, match="'reach'"):
        parse_scale(SCALE, "own.yaml")
    for name, value, words in (
        ("reach", "own_reach:Raech", r"'reach' \(own_reach:Raech\) can't be loaded"),
        ("reach2", "own_reach:Reach", "'reach2'.*has name 'reach'"),
    ):
        install(tmp_path, value, name)
        with pytest.raises(ValueError, match=words):
            registry.kind_of(name)
