"""Meshes that refine themselves: finer where the error is, until error bars are small enough."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import run_coulomb

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material, Traction, box
from coulomb.fem.meshes import finer, volume
from coulomb.io.error_bars import NoErrorBars

STEEL = Material(young=2.119e11, poisson=0.277)


def block(mesh):
    """The block of the demo."""
    loads = [Traction("top", (0.0, 1.0e7, -4.0e7)), Traction("right", (2.0e7, 0.0, 0.0))]
    return ContactProblem(mesh, STEEL, [Clamp("left")], Contact("bottom", friction=0.3), loads)


def cells(mesh):
    return mesh.domain.topology.index_map(3).size_global


def test_a_box_with_equal_errors_stays_even():
    mesh = box((3.0, 1.0, 1.0), (6, 2, 2))
    found = finer(mesh, {"": np.ones(24)})
    assert [len(planes) - 1 for planes in found.grid.planes] == [9, 3, 3]
    for planes, length in zip(found.grid.planes, (3.0, 1.0, 1.0), strict=True):
        np.testing.assert_allclose(planes, np.linspace(0.0, length, len(planes)), atol=1e-12)
    assert cells(found.coarser()) == 24


def test_a_body_without_any_error_is_divided_evenly():
    found = finer(box((1.0, 1.0, 1.0), (2, 2, 2)), {"": np.zeros(8)})
    np.testing.assert_allclose(found.grid.planes[0], np.linspace(0.0, 1.0, 4), atol=1e-12)


def test_no_mesh_has_more_unknowns_than_are_allowed():
    """Also the second; the bars are then those of `Solution.error`."""
    found = block(box((3.0, 1.0, 1.0), (6, 2, 2))).refine(1e-6, unknowns=200)
    assert found.solution.problem.unknowns["displacement"] == 162 and "more than 200" in found.trouble
    bar = found.solution.error()["totals.normal_force"].bar
    assert found.bars["totals.normal_force"].bar == pytest.approx(bar, rel=1e-6)


def test_planes_are_where_the_error_is():
    mesh = box((1.0, 1.0, 1.0), (4, 4, 4))
    found = finer(mesh, {"": np.where(mesh.grid.slabs[0] == 0, 8.0, 1e-3)})
    along, *others = found.grid.planes
    assert np.sum(along < 0.25) >= 3 and along[0] == 0.0 and along[-1] == 1.0
    for planes in others:
        np.testing.assert_allclose(planes, np.linspace(0.0, 1.0, 7), atol=1e-12)


def test_a_body_without_error_stays_and_marked_tetrahedra_are_divided():
    cube = replace(box((1.0, 1.0, 1.0), (2, 2, 2), "tetrahedron"), grid=None)
    mesh = coulomb.fem.meshes.JoinedMesh({"one": cube, "other": coulomb.moved(cube, (0.0, 0.0, 2.0))})
    squared = {"one": np.zeros(48), "other": np.zeros(48)}
    squared["one"][7] = 1.0
    found = finer(mesh, squared)
    assert found.bodies["other"].domain is mesh.bodies["other"].domain
    assert 48 + 8 <= cells(found.bodies["one"]) + 1 < 8 * 48
    assert volume(found.bodies["one"]) == pytest.approx(1.0, rel=1e-12)


def test_a_graded_mesh_has_less_error_than_an_even_one_with_more_unknowns():
    """The singular edge of the clamp; 104.77 MN are extrapolated from second order on 18 x 6 x 6 and 36 x 12 x 12."""
    refined, exact = block(box((3.0, 1.0, 1.0), (6, 3, 3))).refine(0.02), 104.77e6
    even = block(box((3.0, 1.0, 1.0), (30, 10, 10))).solve()
    assert refined.trouble == "" and refined.largest <= 0.02
    assert refined.solution.problem.unknowns["displacement"] < even.problem.unknowns["displacement"]
    errors = [exact - one.at_nodes.totals()["normal_force"] for one in (refined.solution, even)]
    assert 0.0 < errors[0] < 0.7 * errors[1]
    assert errors[0] <= refined.bars["totals.normal_force"].bar[0]


def test_what_cannot_be_refined():
    problem = block(box((3.0, 1.0, 1.0), (3, 1, 1)))
    with pytest.raises(NoErrorBars, match=r"there is no total 'totals.bogus'; there are totals.force"):
        problem.refine(0.02, ["totals.bogus"])
    found = problem.refine(1e-6, unknowns=500)
    assert "more than 500" in found.trouble and found.solution.problem.unknowns["displacement"] <= 500


CASE = """
[mesh]
box = [3.0, 1.0, 1.0]
cells = [6, 2, 2]
cell = "CELL"
[material]
young = 2.0e11
poisson = 0.3
[[clamp]]
face = "left"
[[traction]]
face = "top"
value = [0.0, 0.0, -1.0e7]
[contact]
face = "bottom"
friction = 0.3
[output]
picture = false
"""


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_a_run_keeps_its_mesh_and_is_checked_and_run_again(tmp_path, cell):
    case, results = tmp_path / "case.toml", tmp_path / "results"
    case.write_text(CASE.replace("CELL", cell))
    done = run_coulomb("run", case, "--refine-to", "10%", "--output", results)
    assert done.returncode == 0, done.stderr
    assert "error of the stress" in done.stdout and "error bars of the mesh" in done.stdout
    summary = json.loads((results / "summary.json").read_text())
    meshes = [one["unknowns"] for one in summary["error"]["meshes"]]
    assert meshes[0] == summary["unknowns"]["displacement"] > meshes[1]
    assert (results / "mesh" / "mesh.xdmf").exists()
    checked = run_coulomb("check", results)
    assert checked.returncode == 0, checked.stdout
    again = tmp_path / "again.toml"
    again.write_text(
        CASE.replace("CELL", cell)
        .replace("box = [3.0, 1.0, 1.0]\ncells = [6, 2, 2]\n", "")
        .replace(f'cell = "{cell}"', f'file = "{results / "mesh" / "mesh.xdmf"}"')
    )
    assert run_coulomb("run", again, "--output", tmp_path / "again", "--quiet").returncode == 0
    other = json.loads((tmp_path / "again" / "summary.json").read_text())
    assert other["totals"]["normal_force"] == pytest.approx(summary["totals"]["normal_force"], rel=1e-7)
    assert run_coulomb("run", case, "--refine-to", "10%", "--output", results, "--overwrite").returncode == 0


def test_a_budget_that_does_not_suffice_is_an_error_with_results(tmp_path):
    case, results = tmp_path / "case.toml", tmp_path / "results"
    case.write_text(CASE.replace("CELL", "hexahedron"))
    done = run_coulomb("run", case, "--refine-to", "0.01%", "--most-unknowns", "2000", "--output", results)
    assert done.returncode == 1
    assert "0.01 % was asked for: the next mesh would have" in done.stderr
    assert json.loads((results / "summary.json").read_text())["valid"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--refine-to", "2"], 'must be a part of the totals as in "2%" or "0.02"'),
        (["--refine-to", "much"], 'must be a part of the totals as in "2%" or "0.02"'),
        (["--refine-for", "totals.force"], "give both"),
        (["--refine-to", "2%", "--set", "history={times=[1.0]}"], "--refine-to is for single runs"),
        (["--refine-to", "2%", "--refine-for", "force"], "there is no total 'force'; there are totals.force"),
    ],
)
def test_wrong_options_are_refused(tmp_path, options, said):
    case, results = tmp_path / "case.toml", tmp_path / "results"
    case.write_text(CASE.replace("CELL", "hexahedron"))
    done = run_coulomb("run", case, *options, "--output", results)
    assert done.returncode == 2 and said in done.stderr.replace("\n", " ")
    assert not (results / "summary.json").exists()
