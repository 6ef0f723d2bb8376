"""Small file habits shared by all stages: atomic writes, writes only on change, YAML and JSON lines, checked."""

from __future__ import annotations

import csv
import io
import json
import os
from pathlib import Path
from typing import Any

from object_sets import storage
from reproduce.errors import ReproduceError
from tactile_kit import files
from tactile_kit.files import read_text

CODE = Path(__file__).resolve().parent.parent  # what the packages are in: a checkout, or site-packages
# Where results/ and its agents are: the checkout, or where the command is given if that is not where the packages are.
ROOT = CODE if (CODE / "setup.cfg").is_file() else Path.cwd()


def write_atomic(path: str | os.PathLike, content: str | bytes) -> Path:
    """Writes a file in one move: whoever sees the name sees the whole content. Parents are made."""
    storage.write_atomic(Path(path), content.encode() if isinstance(content, str) else content)
    return Path(path)


def write_if_changed(path: str | os.PathLike, content: str) -> bool:
    """Writes only where the content differs, so that an unchanged file keeps its time stamp. True if written."""
    path = Path(path)
    if path.is_file() and path.read_text(encoding="utf-8") == content:
        return False
    write_atomic(path, content)
    return True


def read_yaml(path: str | os.PathLike) -> Any:
    """A YAML file's content; ``ReproduceError`` names the file and line where it is malformed or missing."""
    return files.read_yaml(Path(path), ReproduceError)


def dump_yaml(value: Any) -> str:
    """YAML text with keys in the order given."""
    import yaml

    return yaml.safe_dump(value, sort_keys=False, allow_unicode=True, width=120)


def read_json(path: str | os.PathLike) -> Any:
    """A JSON file's content; ``ReproduceError`` names the file where it is malformed or missing."""
    text = read_text(Path(path), ReproduceError)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ReproduceError(f"{path}: not valid JSON: {error}") from None


def require_agent(directory: Path) -> Path:
    """The directory, where it holds an agent; else ``ReproduceError``. Looks no further: loading takes seconds."""
    if not (directory / "agent.json").is_file():
        raise ReproduceError(f"{directory}: no agent there (agent.json is missing)")
    return directory


def read_csv(path: Path) -> list[dict[str, str]]:
    """A CSV file's lines by column, as text."""
    try:
        return list(csv.DictReader(io.StringIO(read_text(path, ReproduceError), newline="")))
    except csv.Error as error:
        raise ReproduceError(f"{path}: no CSV ({error})") from None


def shown(path: str | os.PathLike) -> str:
    """The path below the repository where it is below it, else as it is: what files and reports may mention."""
    path = Path(path)
    try:
        return path.resolve().relative_to(ROOT).as_posix()
    except ValueError:
        return path.as_posix()
