"""Bullet says nothing when it is loaded, and everyone loads it from the one place that keeps it quiet."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_no_banner() -> None:
    code = "import tactile_kit.simulation.world, os; os.write(1, b'out'); os.write(2, b'err')"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, check=True)
    assert (done.stdout, done.stderr) == (b"out", b"err")  # both still reach their ends afterwards


def test_one_place_imports_it() -> None:
    loud = [
        path.name
        for package in ("object_sets", "randomization", "reproduce", "tactile_kit")
        for path in (ROOT / package).rglob("*.py")
        if re.search(r"^\s*(import pybullet|from pybullet)", path.read_text(), re.MULTILINE)
    ]
    assert loud == ["quiet_bullet.py"]
