"""The tutorials in docs/notebooks, run as a reader runs them."""

import shutil
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from tests.docs.blocks import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_its_results(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    folder = tmp_path / "reader"
    folder.mkdir()
    notebook = nbformat.reads(path.read_text(encoding="utf-8"), as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert cells and not [cell for cell in cells if cell.outputs], "commit notebooks without their outputs"
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(folder)}}).execute()
    assert not [cell.source for cell in cells[1:] if not cell.outputs]
    shown = [output.data.get("text/html", "") for cell in cells for output in cell.outputs if "data" in output]
    assert sum("data:image/png;base64," in text for text in shown) >= 2  # the map and the run draw themselves
    shutil.rmtree(folder / "generated")
