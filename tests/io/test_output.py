"""The files of a run, read by other software."""

import csv
import json

import numpy as np
import pytest
import pyvista
from check_runs import read_grid
from conftest import make_block, solved_block

from coulomb import Clamp, Contact, ContactProblem, Material, SuccessiveTresca, box
from coulomb.io import output
from coulomb.model.nodal_answer import ACCUMULATED, HELD, OPEN, SLIP, STICK
from coulomb.pictures import drawing_process
from coulomb.pictures.picture_of_run import write_with_picture
from coulomb.pictures.report.fields import Limits, named
from coulomb.pictures.report.files import read_run
from coulomb.pictures.report.scene import Look, shoot


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    solution = solved_block(6)
    directory = tmp_path_factory.mktemp("run")
    solution.write(directory)
    return solution, directory


def test_files(run):
    _, directory = run
    expected = {"solution.xdmf", "solution.h5", "contact.xdmf", "contact.h5"}
    expected |= {"iterations.csv", "summary.json", "picture.png"}
    assert {path.name for path in directory.iterdir()} == expected


def test_vtk_reads_the_body(run):
    """VTK's XDMF reader is one of ParaView's."""
    solution, directory = run
    grid = pyvista.XdmfReader(str(directory / "solution.xdmf")).read()
    grid = grid if isinstance(grid, pyvista.DataSet) else grid[0]
    assert grid.n_cells == 18 * 6 * 6 and grid.n_points == 19 * 7 * 7
    assert set(grid.point_data.keys()) == {"displacement", "load", "held", "prescribed", "spring_force", "reaction"}
    components = {f"stress_{pair}" for pair in ("xx", "yy", "zz", "yz", "xz", "xy")}
    principal = {f"principal_stress_{number}" for number in (1, 2, 3)}
    assert set(grid.cell_data.keys()) == {"von_mises_stress", *components, *principal, "young", "poisson"}
    ours = solution.displacement[np.lexsort(solution.problem.elasticity.x.round(9).T)]
    theirs = np.asarray(grid["displacement"])[np.lexsort(np.asarray(grid.points).round(6).T)]
    assert np.allclose(ours, theirs, rtol=1e-6, atol=1e-9 * np.abs(ours).max())
    assert 1e7 < grid["von_mises_stress"].max() < 1e9


def test_vtk_reads_the_contact_surface(run):
    solution, directory = run
    grid = pyvista.XdmfReader(str(directory / "contact.xdmf")).read()
    grid = grid if isinstance(grid, pyvista.DataSet) else grid[0]
    assert grid.n_cells == 18 * 6 and grid.n_points == 19 * 7
    names = {"pressure", "friction_traction", "slip", "gap", "status", "friction_use"}
    names |= {
        "contact_force",
        "normal",
        "initial_gap",
        "given_gap",
        "area",
        "slip_bound",
        "slip_origin",
        "face",
        "node",
    }
    names |= {"normal_compliance", "tangential_compliance"}
    names |= {"coefficient", "friction", "cohesion", "tangent_1", "tangent_2", *ACCUMULATED}
    assert set(grid.point_data.keys()) == names
    surface, x = solution.problem.surface, solution.contact_force.reshape(-1, 3)
    held = np.isclose(grid.points[:, 0], 0.0)
    assert np.all(grid["status"][held] == HELD) and np.abs(grid["pressure"][held]).max() <= 1e-6
    order = np.lexsort(np.asarray(grid.points)[~held].round(6).T)
    mine = np.lexsort(surface.x.round(9).T)

    def field(name):
        return np.asarray(grid[name])[~held][order]

    assert np.allclose(field("pressure"), (x[:, 0] / surface.area)[mine], rtol=1e-6)
    tangential = np.column_stack([-x[:, 1:] / surface.area[:, None], np.zeros(len(x))])
    assert np.allclose(field("friction_traction"), tangential[mine], rtol=1e-6, atol=1.0)
    assert np.all(field("gap") >= -1e-9) and np.allclose(field("slip")[:, 2], 0.0)
    opposing = np.einsum("ki,ki->k", field("friction_traction"), field("slip"))
    assert np.all(opposing <= 1e-3)  # friction never pushes along the slip
    codes = np.rint(field("status"))
    counts = {name: int(np.sum(codes == code)) for name, code in (("open", 0), ("stick", 1), ("slip", 2))}
    assert counts == {"open": 18, "stick": 8, "slip": 100}  # tests/data/block.json
    assert np.all(field("friction_use")[codes == SLIP] >= 0.999)
    assert np.all(field("friction_use")[codes == STICK] < 0.999)
    assert np.abs(field("friction_use")[codes == OPEN]).max() <= 1e-12


def test_summary(run):
    solution, directory = run
    contents = json.loads((directory / "summary.json").read_text())
    assert contents["status"] == "converged" and contents["law"] == "coulomb" and contents["picture"] == "picture.png"
    assert contents["unknowns"] == {"displacement": 9 * 6 * 49, "contact": 9 * 6 * 7}
    assert contents["iterations"]["outer"] == solution.result.outer_steps
    assert contents["iterations"]["products"] == solution.result.products > contents["iterations"]["krylov"]
    force = contents["force_on_body"]
    assert force["vector"] == pytest.approx([*force["tangential"], force["normal"]])
    assert contents["certificate"]["passed"] is True
    assert contents["certificate"]["penetration"]["value"] <= contents["certificate"]["penetration"]["limit"]
    assert {"assembly", "stiffness", "compliance", "solve", "output", "picture"} <= set(contents["seconds"])
    assert contents["maximum"]["penetration"] == solution.certificate.penetration


def test_history(run):
    solution, directory = run
    with (directory / "iterations.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == solution.result.newton_steps
    assert float(rows[-1]["residual"]) == solution.result.history[-1].residual


def test_history_of_successive_tresca(tmp_path):
    solution = make_block(2).solve(solver=SuccessiveTresca())
    output.write(solution, tmp_path)
    with (tmp_path / "iterations.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == solution.result.outer_steps
    assert float(rows[-1]["residual"]) == solution.result.history[-1].residual
    assert sum(int(row["path_following"]) for row in rows) == solution.result.newton_steps
    assert sum(int(row["products"]) for row in rows) < solution.result.products


def test_a_picture_that_cannot_be_drawn_loses_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(drawing_process.sys, "executable", "/nonexistent/python")
    contents = write_with_picture(solved_block(4), tmp_path)
    assert contents["picture"].startswith("could not be drawn")
    assert json.loads((tmp_path / "summary.json").read_text())["certificate"]["passed"]
    assert not (tmp_path / "picture.png").exists() and (tmp_path / "contact.h5").exists()


def test_a_body_of_one_cell_has_pictures(tmp_path):
    """Its fields on cells have one value."""
    problem = ContactProblem(
        box((1.0, 1.0, 1.0), (1, 1, 1)), Material(1e9, 0.3), [Clamp("top")], Contact("bottom", 0.3)
    )
    output.write(problem.solve(), tmp_path)
    fields = read_grid(tmp_path / "solution.xdmf").fields
    assert fields["von_mises_stress"].shape == (1,) and fields["displacement"].shape == (8, 3)
    shot = shoot(read_run(tmp_path).steps[0], Look(named("von_mises_stress"), Limits(0.0, 1.0), 1.0, "iso"), (60, 60))
    assert shot.pixels[:, :, 3].any()
