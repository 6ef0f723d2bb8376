"""The notebooks run, from the checkout's root, and are committed as executed."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbclient = pytest.importorskip("nbclient", reason="no nbclient")
    nbformat = pytest.importorskip("nbformat")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.delenv(
        "MPLBACKEND", raising=False
    )  # the kernel has one of its own, whose pictures are outputs
    notebook = nbformat.read(path, 4)
    committed = [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]
    nbclient.NotebookClient(notebook, timeout=240, resources={"metadata": {"path": str(ROOT)}}).execute()
    fresh = [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]
    assert [list(map(kind, outputs)) for outputs in committed] == [
        list(map(kind, outputs)) for outputs in fresh
    ]
    assert any("image/png" in kind(output) for outputs in fresh for output in outputs)


def kind(output: dict) -> str:
    """What an output is, whatever it says: numbers may differ between machines."""
    return " ".join([output["output_type"], *sorted(output.get("data", {}))])


def test_there_are_two() -> None:
    assert len(NOTEBOOKS) == 2
