"""The tutorials' blocks run, in order, as a reader would run them: files are written, commands and Python executed.

A block with a title is a file of that name. Agents and packages are the checkout's; the own hand is tried in a copy.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```(\w+)(?: title=\"([^\"]+)\")?\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page: str) -> list[tuple[str, str, str]]:
    """(language, title, content) of a page's blocks."""
    return BLOCK.findall((ROOT / "docs" / page).read_text(encoding="utf-8"))


def follow(page: str, folder: Path, packages: Path, skip: str = "") -> list[str]:
    """Does what the page says in ``folder``; returns the kinds of what was done. ``skip``: words of blocks left out."""
    environment = os.environ | {
        "PYTHONPATH": f"{packages}:{folder}",
        "OMP_NUM_THREADS": "1",
        "MPLBACKEND": "Agg",
    }
    environment["PATH"] = f"{Path(sys.executable).parent}:{environment['PATH']}"
    done = []
    for language, title, content in blocks(page):
        if skip and re.search(skip, content):
            continue
        if title:
            (folder / title).write_text(content)
            continue
        command = {"python": [sys.executable, "-c", content], "bash": ["bash", "-ec", content]}.get(language)
        if command is None:
            continue
        ran = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        assert ran.returncode == 0, f"{page}:\n{content}\n{ran.stdout}{ran.stderr}"
        done.append(language)
    return done


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "results").symlink_to(ROOT / "results")
    (tmp_path / ".venv").mkdir()
    (tmp_path / ".venv" / "bin").symlink_to(Path(sys.executable).parent)
    return tmp_path


def test_own_randomization(folder: Path) -> None:
    assert follow("own-randomization.md", folder, ROOT) == ["python"]


def test_own_encoding(folder: Path) -> None:
    """The commands at the end train for minutes; others test them."""
    assert follow("own-encodings.md", folder, ROOT, skip="train-estimator") == ["python"]


def test_own_objects(folder: Path) -> None:
    """But for the random ones and a whole evaluation, which take minutes."""
    import trimesh

    (folder / "FOLDER").mkdir()
    trimesh.creation.box((0.06, 0.05, 0.04)).export(folder / "FOLDER" / "mug.stl")
    assert follow("own-objects.md", folder, ROOT, skip="reproduce evaluate|object-sets sample") == [
        "bash",
        "python",
    ]


def test_own_hand(folder: Path) -> None:
    copy = folder / "checkout"
    for name in ("tactile_kit", "object_sets", "randomization"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    assert follow("own-hand.md", copy, copy) == ["bash", "python", "python"]
    assert "0.0331" in (ROOT / "tactile_kit" / "hand" / "kinematics.py").read_text()


def test_start(folder: Path) -> None:
    """Its commands are tested elsewhere, but for Python, and for the settings that it writes."""
    from tactile_kit.runs import RunConfig

    assert follow("start.md", folder, ROOT) == ["python"]
    assert RunConfig.from_yaml(folder / "my_run.yaml").objects == "cube"


def test_faq(folder: Path) -> None:
    assert follow("faq.md", folder, ROOT) == ["python"]
