"""Snakemake profiles: a folder of one's own, or one that comes along, by name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from reproduce.errors import ReproduceError
from reproduce.files import read_yaml
from tactile_kit.errors import nearest

FOLDER = Path(__file__).parent / "profiles"
CONFIG = ("config.v8+.yaml", "config.yaml")  # in the order in which Snakemake looks


@dataclass(frozen=True)
class Profile:
    """A profile, and what we have to know of it."""

    folder: Path
    retries: int  # of a job that failed
    seconds: float  # between questions to the scheduler


def load_profile(name_or_path: str) -> Profile:
    """The profile in that folder, or the one of that name that comes along.

    Raises ``ReproduceError`` naming what is there instead, or the value that is out of range.
    """
    known = sorted(file.parent.name for file in FOLDER.glob("*/config.yaml"))
    folder = Path(name_or_path)
    if name_or_path in known and not folder.is_dir():
        folder = FOLDER / name_or_path
    file = next((folder / name for name in CONFIG if (folder / name).is_file()), None)
    if file is None:
        raise ReproduceError(
            f"--profile {name_or_path}: no folder with a config.yaml, and no name of a profile that comes along"
            + nearest(name_or_path, known)
        )
    content = read_yaml(file) or {}
    retries = content.get("retries", content.get("restart-times", 0))
    seconds = content.get("seconds-between-status-checks", 10)
    if type(retries) is not int or retries < 0:
        raise ReproduceError(f"{file}: retries {retries!r}; allowed are integers >= 0")
    if not isinstance(seconds, int | float) or seconds <= 0:
        raise ReproduceError(f"{file}: seconds-between-status-checks {seconds!r}; allowed are numbers > 0")
    return Profile(folder.resolve(), retries, float(seconds))
