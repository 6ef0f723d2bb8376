"""What fuzzing has found and kept: every reader still takes each of these files, or refuses it by name, at once."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from fuzz import CORPUS, kept
from readers import READERS, complaint


@pytest.mark.parametrize("name", READERS)
def test_whole_files_are_read(name: str, tmp_path: Path) -> None:
    for number, data in enumerate(READERS[name].examples()):
        (tmp_path / str(number)).mkdir()
        assert complaint(name, data, tmp_path / str(number)) == ""


@pytest.mark.parametrize("name", READERS)
def test_a_reader_refuses_what_it_can_not_read(name: str, tmp_path: Path) -> None:
    with pytest.raises(READERS[name].refuses):
        READERS[name].read(b"\xff\x00nothing of use", tmp_path)


@pytest.mark.parametrize("name", sorted(path.stem for path in CORPUS.glob("*.zip")))
def test_kept_files_do_no_harm(name: str, tmp_path: Path) -> None:
    files = kept(name)
    wrong, begin = {}, time.process_time()
    for member, data in files:
        folder = tmp_path / member
        folder.mkdir()
        if said := complaint(name, data, folder):
            wrong[member] = said
    assert not wrong
    assert time.process_time() - begin < 0.5 * len(files) + 10


def test_there_is_no_corpus_without_a_reader() -> None:
    assert {path.stem for path in CORPUS.glob("*.zip")} <= set(READERS)
