"""What is installed without a checkout: every data file is in the wheel, and the commands work from it, anywhere."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("object_sets", "randomization", "reproduce", "tactile_kit")

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("wheel")]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("build", reason="no package build")
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("dist")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("setup.cfg", "pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(source)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return next(out.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Commands of a new environment that has the wheel, and its dependencies from the one that tests."""
    environment = tmp_path_factory.mktemp("environment")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True)
    python = environment / "bin" / "python"
    install = [
        "-m",
        "pip",
        "--python",
        str(python),
        "install",
        "--quiet",
        "--no-deps",
        "--no-index",
        str(wheel),
    ]
    subprocess.run([sys.executable, *install], check=True)
    # A path file takes over the folder of packages, but not the path files in it: no editable install comes along.
    code = "import sysconfig; print(sysconfig.get_path('purelib'))"
    purelib = subprocess.check_output([python, "-c", code], text=True).strip()
    (Path(purelib) / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return environment / "bin"


def run(command: list[str | Path], folder: Path) -> str:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        list(map(str, command)), cwd=folder, env=environment | {"OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_every_file_is_in_the_wheel(wheel: Path) -> None:
    inside = set(zipfile.ZipFile(wheel).namelist())
    files = {
        path.relative_to(ROOT).as_posix()
        for name in PACKAGES
        for path in (ROOT / name).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert files - inside == set()


def test_an_agent_is_trained_evaluated_and_filmed(installed: Path, tmp_path: Path) -> None:
    where = run([installed / "python", "-c", "import tactile_kit; print(tactile_kit.__file__)"], tmp_path)
    assert where.startswith(str(installed.parent))
    assert "cube" in run([installed / "object-sets", "list"], tmp_path)
    # In Bullet: the other physics would be compiled for a minute, for an environment that lives no longer.
    (tmp_path / "my.yaml").write_text(
        "{preset: ppo-smoke, objects: cube, encoding: vec_bps, steps: 1024, episodes: {engine: bullet, drag: null}}"
    )
    assert "trained" in run([installed / "reproduce", "train", "my.yaml", "--out", "mine"], tmp_path)
    common = ["--agent", "mine", "--objects", "cube"]
    evaluated = run([installed / "reproduce", "evaluate", *common, "--out", "mine.csv", "--json"], tmp_path)
    assert json.loads(evaluated)["episodes"] == 24
    run([installed / "reproduce", "view", *common, "--record", "mine.html"], tmp_path)


def test_the_workflow_is_planned_where_it_is_called(installed: Path, tmp_path: Path) -> None:
    """The Snakefile finds every file it names; results are beside the command, not beside the packages."""
    code = (
        "from reproduce import pipeline, plan, prepare, provenance, scales\n"
        "from reproduce.plan import default_out\n"
        "made = plan.make_plan(scales.load_scale('smoke'), 'pretrained', default_out('smoke', 'pretrained'))\n"
        "config = prepare.prepare(made)\n"
        "print(*pipeline._wanted(pipeline._command(made, config, 2, None), config))\n"
        "assert provenance.differences()"
    )
    assert {"table1", "learning", "claims", "report"} <= set(
        run([installed / "python", "-c", code], tmp_path).split()
    )
    assert (tmp_path / "results" / "smoke" / ".pipeline" / "plan.json").is_file()
    run([installed / "reproduce", "stage", "table1", "--scale", "smoke"], tmp_path)
    assert (tmp_path / "results" / "smoke" / "tables" / "table1.tex").is_file()
