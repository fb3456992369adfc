"""The notebooks of the documentation run, and what they show."""

import re

import pytest
from conftest import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
SHOWN = {
    "block": ("contact problem", "certificate passed", "<img src=", "friction use"),
    "own_forms": ("certificate passed", "pad:bottom", "held by the clamp: [-43.2"),
    "hysteresis": ("21 load steps", "True that all steps are certified", "image/png"),
}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(notebook, timeout=240, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = " ".join(str(cell.get("outputs")) for cell in notebook.cells)
    for words in SHOWN[path.stem]:
        assert words in re.sub(r"\s+", " ", shown), words
