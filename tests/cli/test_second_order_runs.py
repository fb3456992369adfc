"""Runs of case files with second-order meshes: several ranks, load histories, resume and check."""

import json
import shutil

import numpy as np
import pytest
from conftest import run_coulomb
from mesh_files import BoxFile

from coulomb.recheck import check

CASE = """
prescribed_displacement = [{ face = "top", value = [4e-3, 0.0, -2e-3], amplitude = [[0, 0], [2, 1]] }]
history = { times = [1.0, 2.0] }
output = { picture = false }
[mesh]
file = "part.msh"
[[material]]
cells = "soft"
young = 1e7
poisson = 0.3
[[material]]
cells = "stiff"
young = 2e7
poisson = 0.3
[contact]
face = "bottom"
friction = 0.4
motion = [[0.0, 0.0, 0.0, 0.0], [2.0, 0.0, 1e-3, 0.0]]
gap = "1e-4*x**2"
foundation = { shape = "plane", point = [0, 0, 0], normal = [0, 0, 1] }
"""


def bent(x):
    """Sides that bulge, and a bottom that stays plane."""
    return x + np.column_stack([np.zeros(len(x)), 0.1 * x[:, 0] ** 2, 0.05 * x[:, 0] * x[:, 2]])


def last(folder):
    return json.loads((folder / "steps" / "0002" / "summary.json").read_text())["totals"]


@pytest.mark.parametrize(("cell", "raised"), [("hexahedron", False), ("tetrahedron", True)])
def test_history_resumed_on_other_ranks(cell, raised, tmp_path):
    """A file of curved cells, or of first-order ones that are raised, on several ranks; resumed on one, and every step
    checked from the files; against the same on one rank."""
    file = BoxFile((2.0, 1.0, 1.0), (2, 1, 1), cell)
    (file if raised else file.second_order(bent)).write(tmp_path / "part.msh")
    (tmp_path / "case.toml").write_text(CASE.replace("[mesh]\n", "[mesh]\ndegree = 2\n") if raised else CASE)
    for out, given in (("one", None), ("several", 2)):
        done = run_coulomb("run", "case.toml", "--output", out, ranks=given, cwd=tmp_path)
        kind = "10-node tetrahedra" if cell == "tetrahedron" else "27-node hexahedra"
        assert kind in next(line for line in done.stdout.splitlines() if line.startswith("body "))
    out, whole = tmp_path / "several", last(tmp_path / "one")
    shutil.rmtree(out / "steps" / "0002")
    run_coulomb("resume", out, cwd=tmp_path)
    found = check(out)
    assert found.passed, str(found)
    again = last(out)
    for name in ("force", "moment"):
        assert np.allclose(again[name], whole[name], rtol=1e-6, atol=1e-6 * np.abs(whole["force"]).max())
    assert again["contact_area"] == pytest.approx(whole["contact_area"], rel=1e-9)
    assert again["dissipated_energy"] == pytest.approx(whole["dissipated_energy"], rel=1e-5)
