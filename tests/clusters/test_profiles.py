"""Profiles by name and by folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from reproduce.clusters import scheduler
from reproduce.errors import ReproduceError
from reproduce.profiles import FOLDER, load_profile


def test_by_name_and_by_folder(tmp_path: Path) -> None:
    slurm = load_profile("slurm")
    assert slurm.folder == FOLDER / "slurm" and slurm.retries == 3 and slurm.seconds == 10
    (tmp_path / "config.yaml").write_text("executor: local\nrestart-times: 2\n")
    mine = load_profile(str(tmp_path))
    assert mine.folder == tmp_path and mine.retries == 2 and mine.seconds == 10


def test_a_folder_of_that_name_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slurm").mkdir()
    (tmp_path / "slurm" / "config.v8+.yaml").write_text("retries: 7\n")
    assert load_profile("slurm").retries == 7


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("retries: many\n", "retries 'many'; allowed"),
        ("seconds-between-status-checks: 0\n", "0; allowed"),
        ("a: [\n", "YAML"),
    ],
)
def test_refusals(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "config.yaml").write_text(text)
    with pytest.raises(ReproduceError, match=said):
        load_profile(str(tmp_path))


def test_the_nearest_name() -> None:
    with pytest.raises(ReproduceError, match=r"--profile slum: no folder with a config\.yaml.*slurm"):
        load_profile("slum")
    with pytest.raises(ReproduceError, match=r"scheduler 'slurmm' unknown.*slurm"):
        scheduler("slurmm")
