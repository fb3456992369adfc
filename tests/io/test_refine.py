"""Meshes that refine themselves: finer where the error is, until error bars are small enough."""

import json
import math
import re
from dataclasses import replace

import dolfinx
import numpy as np
import pytest
from conftest import SMALL_CASE, run_coulomb

import coulomb
from coulomb import Clamp, Contact, ContactProblem, LoadHistory, Material, Traction, box
from coulomb.fem.meshes import few_chords, finer, refined, second_order, volume
from coulomb.io.answer import answer_of
from coulomb.io.other_meshes import NoErrorBars
from coulomb.io.refinement import refine
from coulomb.solvers.results import NotConverged
from verification import hertz, ring_pair
from verification.array_mesh import quarter_ring

STEEL = Material(young=2.119e11, poisson=0.277)


def block(mesh):
    """The block of the demo."""
    loads = [Traction("top", (0.0, 1.0e7, -4.0e7)), Traction("right", (2.0e7, 0.0, 0.0))]
    return ContactProblem(mesh, STEEL, [Clamp("left")], Contact("bottom", friction=0.3), loads)


def energy(solution):
    return answer_of(solution, 1e-8).totals["strain_energy"][0][0]


def cells(mesh):
    return mesh.domain.topology.index_map(3).size_global


def test_a_box_with_equal_errors_stays_even():
    mesh = box((3.0, 1.0, 1.0), (6, 2, 2))
    found = finer(mesh, {"": np.ones((3, 24))})
    assert [len(planes) - 1 for planes in found.grid.planes] == [8, 3, 3]
    for planes, length in zip(found.grid.planes, (3.0, 1.0, 1.0), strict=True):
        np.testing.assert_allclose(planes, np.linspace(0.0, length, len(planes)), atol=1e-12)
    assert cells(found.coarser()) == 24


def test_slabs_across_a_direction_without_error_stay_even():
    """Whose error is 0, or rounding."""
    mesh = box((1.0, 1.0, 1.0), (4, 4, 4))
    rng = np.random.default_rng(0)
    for noise in (np.zeros(64), 1e-30 * rng.random(64)):
        across_x = np.where(mesh.grid.slabs[0] == 0, 1.0, 0.01)
        planes = finer(mesh, {"": np.stack([across_x, noise, noise])}).grid.planes
        assert np.ptp(np.diff(planes[0])) > 0.05 and len(planes[0]) > 5
        for others in planes[1:]:
            np.testing.assert_allclose(np.diff(others), 1.0 / (len(others) - 1), rtol=1e-9)


def test_a_body_without_any_error_is_divided_evenly():
    found = finer(box((1.0, 1.0, 1.0), (2, 2, 2)), {"": np.zeros((3, 8))})
    np.testing.assert_allclose(found.grid.planes[0], np.linspace(0.0, 1.0, 4), atol=1e-12)


def test_no_mesh_has_more_unknowns_than_are_allowed():
    """Also the second; the bars are then those of `Solution.error`."""
    found = block(box((3.0, 1.0, 1.0), (6, 2, 2))).refine(1e-6, unknowns=200)
    assert found.solution.problem.unknowns["displacement"] == 162 and "more than 200" in found.trouble
    bar = found.solution.error()["totals.normal_force"].bar
    assert found.bars["totals.normal_force"].bar == pytest.approx(bar, rel=1e-6)


def test_planes_are_where_the_error_is():
    """And only across the direction in which a finer mesh makes it smaller."""
    mesh = box((1.0, 1.0, 1.0), (4, 4, 4))
    found = finer(mesh, {"": np.stack([np.where(mesh.grid.slabs[0] == 0, 8.0, 1e-3), *np.full((2, 64), 1e-3)])})
    along, *others = found.grid.planes
    assert len(along) == 13 and np.sum(along < 0.25) >= 6 and along[0] == 0.0 and along[-1] == 1.0
    for planes in others:
        np.testing.assert_allclose(planes, np.linspace(0.0, 1.0, 5), atol=1e-12)


def test_planes_make_the_errors_of_all_directions_equal():
    """Those of a known density, ((x + 0.02)^-2, 1, 1/16) times the squared widths of the cells; and far smaller."""

    def errors(mesh):
        at, slabs = mesh.grid.planes, mesh.grid.slabs
        widths = np.stack([np.diff(along)[slab] for along, slab in zip(at, slabs, strict=True)])
        x = 0.5 * (at[0][1:] + at[0][:-1])[slabs[0]]
        density = np.stack([(x + 0.02) ** -2, np.ones_like(x), np.full_like(x, 1 / 16)])
        return density * widths**2 * widths.prod(axis=0)

    mesh = box((1.0, 1.0, 1.0), (2, 2, 2))
    for _ in range(6):
        mesh = finer(mesh, {"": errors(mesh)})
    found = errors(mesh).sum(axis=1)
    evenly = errors(box((1.0, 1.0, 1.0), [len(along) - 1 for along in mesh.grid.planes]))
    assert found.max() < 2.0 * found.min() and found.sum() < 0.6 * evenly.sum()


def test_planes_go_to_the_body_with_more_error():
    bodies = {
        "one": box((1.0, 1.0, 1.0), (4, 4, 4)),
        "other": coulomb.moved(box((1.0, 1.0, 1.0), (4, 4, 4)), (2, 0, 0)),
    }
    mesh = coulomb.fem.meshes.JoinedMesh(bodies)
    found = finer(mesh, {"one": np.ones((3, 64)), "other": np.full((3, 64), 0.03)})
    one, other = (cells(found.bodies[name]) for name in bodies)
    assert other == 64 and 384 - 64 <= one < 450


def test_a_refined_contact_of_hertz_has_its_cells_there():
    """Beside an even mesh with five times the unknowns: half the error of the strain energy, of which second order on
    the graded mesh of the verification tells."""
    fine, width = hertz.problem(5, 6.0 * hertz.A), 6.0 * hertz.A
    exact = energy(fine.on(second_order(fine.made_of)).at(1.0).solve())
    refined = fine.on(box((width,) * 3, (4, 4, 4))).at(1.0).refine(1e-6, unknowns=3500).solution
    planes, unknowns = refined.problem.made_of.grid.planes, refined.problem.unknowns["displacement"]
    for along in planes:
        assert np.sum(along <= 2.0 * hertz.A) > 0.6 * len(along)
        assert np.diff(along)[0] < 0.3 * np.diff(along)[-1]
    even = fine.on(box((width,) * 3, (16, 16, 16))).at(1.0).solve()
    assert even.problem.unknowns["displacement"] > 5 * unknowns
    assert abs(energy(refined) - exact) < 0.5 * abs(energy(even) - exact)


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
    refined, exact = block(box((3.0, 1.0, 1.0), (6, 2, 2))).refine(0.02), 104.77e6
    even = block(box((3.0, 1.0, 1.0), (30, 10, 10))).solve()
    assert refined.trouble == "" and refined.largest <= 0.02
    assert refined.solution.problem.unknowns["displacement"] < even.problem.unknowns["displacement"]
    errors = [exact - one.at_nodes.totals()["normal_force"] for one in (refined.solution, even)]
    assert 0.0 < errors[0] < 0.7 * errors[1]
    assert errors[0] <= refined.bars["totals.normal_force"].bar[0]


def standing_ring(mesh):
    """A quarter of a ring that stands on its end, by its weight alone."""
    steel = replace(STEEL, density=7850.0)
    planes = [Clamp("front", "y"), Clamp("back", "x")]
    return ContactProblem(mesh, steel, planes, Contact("bottom", friction=0.0), gravity=(0.0, 0.0, -9.81))


WEIGHT = 7850.0 * 9.81 * 0.25 * math.pi * (1.0**2 - 0.5**2) * 0.6


def coarse_ring(cell, degree=1):
    """With three chords in a quarter of a circle, as of a file."""
    whole = quarter_ring(0.5, 1.0, 0.6, (1, 3, 1), cell)
    mesh = replace(whole, grid=None, coarser=None)
    return mesh if degree == 1 else second_order(mesh)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_the_weight_of_a_body_with_curved_faces_is_found(cell):
    """All meshes would have that of the polygon, 4.5 % less, if new nodes were on its facets."""
    found = standing_ring(coarse_ring(cell)).refine(0.03, ["totals.normal_force"])
    assert found.trouble == ""
    bar = found.bars["totals.normal_force"]
    assert abs(bar.value[0] - WEIGHT) <= bar.bar[0] <= 0.03 * WEIGHT


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 1), ("tetrahedron", 2)])
def test_the_polygon_of_a_mesh_is_in_its_bars(cell, degree):
    """Also where another mesh has the same facets: of second order with straight edges, and of refined ones."""
    problem = standing_ring(coarse_ring(cell, degree))
    answer = problem.solve()
    finer_one = problem.on(refined(problem.made_of)).solve()
    for bars in (answer.error(), finer_one.error(answer)):
        bar = bars["totals.normal_force"]
        assert bar.value[0] == pytest.approx(0.955 * WEIGHT, rel=0.005)
        assert abs(bar.value[0] - WEIGHT) <= bar.bar[0] < 0.5 * WEIGHT


@pytest.mark.parametrize(("degree", "most"), [(1, 1500), (2, 4500)])
def test_meshes_refine_on_the_surface_that_a_contact_names(degree, most):
    """A press fit (Lame) with three and four chords in a quarter: new nodes are on the named cylinder, not on a surface
    found from the facets, which is off it by 1.7 mm of 150 after two refinements."""
    fit = ring_pair.rings(1, ("tetrahedron", "tetrahedron"), (degree, degree), facets="cylinders")
    from_files = {name: replace(one, grid=None, coarser=None) for name, one in fit.made_of.bodies.items()}
    found = refine(fit.on(coulomb.fem.meshes.JoinedMesh(from_files)), 1e-6, ["totals.normal_force"], most)
    bar, exact = found.bars["totals.normal_force"], ring_pair.lame() * 0.5 * math.pi * ring_pair.FIT * ring_pair.LENGTH
    assert len(found.bars.answers) >= 3 and abs(bar.value[0] - exact) <= bar.bar[0] < exact
    for name, face in (("inner", "right"), ("outer", "left")):
        mesh = found.solution.problem.made_of.bodies[name]
        V = coulomb.fem.compat.functionspace(mesh.domain, degree)
        on = dolfinx.fem.locate_dofs_topological(V, 2, mesh.faces[face])
        x, y, _ = V.tabulate_dof_coordinates()[on].T
        assert len(on) > 20 and np.abs(np.hypot(x, y) - ring_pair.FIT).max() < 1e-12 * ring_pair.FIT


def test_the_worst_of_the_totals_that_are_asked_for_decides():
    """The error bar over the largest total in its unit."""
    asked = ["totals.normal_force", "totals.greatest_slip", "strain_energy"]
    found = block(box((3.0, 1.0, 1.0), (3, 1, 1))).refine(1e-6, asked, unknowns=400)
    parts = [found.bars[name].bar[0] / found.bars[name].value[0] for name in asked]
    assert found.largest == pytest.approx(max(parts), rel=1e-12) and max(parts) > 1.5 * np.median(parts)
    assert np.argmax(parts) == 1  # neither the first nor the last


def test_an_interrupted_refinement_keeps_the_meshes_it_has_solved():
    problem, said = block(box((3.0, 1.0, 1.0), (3, 1, 1))), []

    def stop(at_mesh):
        return refine(problem, 1e-6, progress=lambda at: len(said) == at_mesh, said=lambda found, _: said.append(found))

    for number in (1, 2):
        said.clear()
        found = stop(number)
        assert len(said) == number and found.solution is said[-1].solution and found.solution.certificate.passed
        assert re.match(r"the next mesh, \d+ unknowns: .*\(interrupted\)", found.trouble)
        assert (found.bars is None) == (number == 1) and (found.largest < np.inf) == (number == 2)
    with pytest.raises(NotConverged, match="interrupted"):
        said.clear()
        stop(0)


@pytest.mark.parametrize("to", [0, -1, np.nan, np.inf, 2, "2%", None, [0.02]], ids=str)
def test_a_target_that_is_no_part_is_refused_at_once(to):
    with pytest.raises(ValueError, match="refine: to must be a part of the totals between 0 and 1"):
        block(box((3.0, 1.0, 1.0), (3, 1, 1))).refine(to)


def test_wrong_arguments_are_refused_at_once():
    problem = block(box((3.0, 1.0, 1.0), (3, 1, 1)))
    with pytest.raises(ValueError, match="totals must be a list of names"):
        problem.refine(0.02, "totals.normal_force")
    with pytest.raises(ValueError, match="unknowns must be a number of displacement unknowns, at least 1, but is 0"):
        problem.refine(0.02, unknowns=0)
    with pytest.raises(ValueError, match="refinement is for single runs"):
        next(iter(LoadHistory([1.0]).steps(problem))).solution.problem.refine(0.02)


def test_facets_of_few_chords_are_said_not_to_be_in_the_bars():
    """Two in a quarter of a circle meet at 45 degrees; a box at 90, and a curved second-order cell has arcs."""
    rings = {n: replace(quarter_ring(0.5, 1.0, 0.6, (1, n, 1)), grid=None, coarser=None) for n in (2, 3)}
    bore, rim = standing_ring(rings[2]).solve().error().warnings
    assert bore.startswith("facets of 'left' meet at 45 degrees") and "8 chords in a circle" in rim
    assert standing_ring(rings[3]).solve().error().warnings == ()
    curved = quarter_ring(0.5, 1.0, 0.6, (1, 2, 1), degree=2)
    for mesh in (replace(curved, grid=None, coarser=None), replace(box((1.0, 1.0, 1.0), (2, 2, 2)), grid=None)):
        assert not few_chords(mesh)


def test_what_cannot_be_refined():
    problem = block(box((3.0, 1.0, 1.0), (3, 1, 1)))
    with pytest.raises(NoErrorBars, match=r"there is no total 'totals.bogus'; there are totals.force.*strain_energy$"):
        problem.refine(0.02, ["totals.bogus"])
    found = problem.refine(1e-6, unknowns=500)
    assert "more than 500" in found.trouble and found.solution.problem.unknowns["displacement"] <= 500


CASE = SMALL_CASE.replace("[3, 1, 1]\n", '[6, 2, 2]\ncell = "CELL"\n')


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_a_run_keeps_its_mesh_and_is_checked_and_run_again(tmp_path, cell):
    case, results = tmp_path / "case.toml", tmp_path / "results"
    case.write_text(CASE.replace("CELL", cell))
    done = run_coulomb("run", case, "--refine-to", "10%", "--output", results)
    assert "error of the stress" in done.stdout and "error bars of the mesh" in done.stdout
    summary = json.loads((results / "summary.json").read_text())
    meshes = [one["unknowns"] for one in summary["error"]["meshes"]]
    assert meshes[0] == summary["unknowns"]["displacement"] > meshes[1]
    assert (results / "mesh" / "mesh.xdmf").exists()
    run_coulomb("check", results)
    again = tmp_path / "again.toml"
    again.write_text(
        CASE.replace("CELL", cell)
        .replace("box = [3.0, 1.0, 1.0]\ncells = [6, 2, 2]\n", "")
        .replace(f'cell = "{cell}"', f'file = "{results / "mesh" / "mesh.xdmf"}"')
    )
    run_coulomb("run", again, "--output", tmp_path / "again", "--quiet")
    other = json.loads((tmp_path / "again" / "summary.json").read_text())
    assert other["totals"]["normal_force"] == pytest.approx(summary["totals"]["normal_force"], rel=1e-7)
    run_coulomb("run", case, "--refine-to", "10%", "--output", results)


def test_a_budget_that_does_not_suffice_is_an_error_with_results(tmp_path):
    case, results = tmp_path / "case.toml", tmp_path / "results"
    case.write_text(CASE.replace("CELL", "hexahedron"))
    done = run_coulomb("run", case, "--refine-to", "0.01%", "--most-unknowns", "2000", "--output", results, code=1)
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
    done = run_coulomb("run", case, *options, "--output", results, code=2)
    assert said in done.stderr.replace("\n", " ")
    assert not (results / "summary.json").exists()
