"""Results of bodies from the user's forms: their files, their check, and histories that are continued."""

import json

import h5py
import numpy as np
import pytest
import ufl
from check_runs import read_grid
from conftest import run_coulomb, without_pictures
from report_pages import page_without_pictures
from test_forms import both
from user_forms import Script

import coulomb
from coulomb import Contact, ContactProblem, HistoryFiles, LoadHistory
from coulomb.fem.compat import fem
from coulomb.recheck import check


def held_by_robin(cell, degree):
    mesh = coulomb.box((1.0, 1.0, 1.0), (2, 2, 2), cell)
    script = Script(mesh, degree)
    robin = 1e9 * ufl.inner(script.u, script.v) * script.ds("top")
    L = ufl.inner(script.constant((3e5, 0.0, -1e6)), script.v) * script.ds("top")
    body = coulomb.Body(script.elasticity(1e10, 0.3) + robin, L, [script.bc(0.0, "front", 1)], mesh)
    return script, ContactProblem(body, Contact("bottom", 0.2)).solve()


@pytest.fixture(scope="module", params=[("tetrahedron", 2), ("hexahedron", 1)], ids=["P2", "Q1"])
def written(request, tmp_path_factory):
    script, solution = held_by_robin(*request.param)
    temperature = fem.Function(script.V.sub(0).collapse()[0])
    temperature.interpolate(lambda x: 300.0 + x[0])
    damage = script.on_cells(lambda x: x[2])
    folder = tmp_path_factory.mktemp("forms")
    with without_pictures():
        solution.write(folder, fields={"heat": temperature, "damage": damage, "twice": solution.function})
    return script, solution, folder


def test_all_values_and_the_users_own_fields_are_in_the_files(written):
    _, solution, folder = written
    grid = read_grid(folder / "solution.xdmf")
    assert grid.cells.shape[1] == {1: 8, 2: 10}[solution.problem.elasticity.degree]
    assert np.array_equal(grid.points, solution.problem.elasticity.x)
    assert np.array_equal(grid.fields["displacement"], solution.displacement)
    assert np.array_equal(grid.fields["twice"], solution.displacement)
    assert np.allclose(grid.fields["heat"], 300.0 + grid.points[:, 0], atol=1e-12)
    assert len(grid.fields["damage"]) == len(grid.cells) and 0.0 < grid.fields["damage"].min() < 0.5
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["fields"] == ["heat", "damage", "twice"] and summary["material"] == []
    assert summary["forms"]["bcs"] == 1 and len(summary["forms"]["a"]) > 20
    assert [part["name"] for part in summary["reactions"]] == ["dirichlet", "form"]


def test_the_check_says_what_it_cannot_know(written):
    found = check(written[2])
    assert found.passed and "not judged without the problem: equilibrium" in str(found), str(found)
    found = check(written[2], written[1].problem)
    assert found.passed and "not judged" not in str(found), str(found)


@pytest.mark.parametrize("name", ["displacement", "internal_force", "load", "rigid_force_1"])
def test_changed_files_are_noticed(written, name, tmp_path):
    for file in written[2].iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    with h5py.File(tmp_path / "solution.h5", "r+") as file:
        data, x = file[f"Function/{name}/0"], file["Mesh/mesh/geometry"][()]
        node = int(np.argmin(np.linalg.norm(x - [0.5, 0.5, 0.0], axis=1)))  # on the contact face
        data[node, 0] += 1e-3 * np.abs(data[()]).max()
    assert not check(tmp_path, written[1].problem).passed


def test_a_history_is_continued_and_checked(tmp_path):
    """Interrupted after two steps and continued by a new body: the numbers of the history without interruption."""
    history = LoadHistory([1.0, 2.0, 3.0])
    history.run(both("hexahedron", 2)[1], HistoryFiles(tmp_path / "whole"))
    stop = iter([False, True])
    history.run(both("hexahedron", 2)[1], HistoryFiles(tmp_path / "two"), on_step=lambda step: next(stop))
    history.run(both("hexahedron", 2)[1], HistoryFiles(tmp_path / "two", resume=True))
    one, other = (json.loads((tmp_path / name / "summary.json").read_text())["last"] for name in ("whole", "two"))
    assert other["step"]["number"] == 3
    assert other["force_on_body"]["normal"] == pytest.approx(one["force_on_body"]["normal"], rel=1e-8)
    assert other["step"]["energy"] == pytest.approx(one["step"]["energy"], rel=1e-8)
    found = check(tmp_path / "two")
    assert found.passed, str(found)
    with pytest.raises(ValueError, match="a, L of the body differ"):
        history.run(both("hexahedron", 2, True)[1], HistoryFiles(tmp_path / "two", resume=True))
    done = run_coulomb("resume", tmp_path / "two", code=2)
    assert "HistoryFiles" in done.stderr and "forms" in done.stderr


@pytest.mark.parametrize("written", [("hexahedron", 1)], indirect=True)
def test_the_report_shows_no_stress_that_is_not_known(written):
    pytest.importorskip("jinja2")
    pytest.importorskip("pyvista")
    page = page_without_pictures(written[2])
    assert "own forms" in page and "von Mises" not in page
