"""Tetrahedra of first order near incompressibility: cases without `degree` take second order, with it what it says."""

from pathlib import Path

import pytest
from mesh_files import BoxFile
from mpi4py import MPI

from coulomb.case.case import read_case
from coulomb.cli import preparation
from coulomb.io.summary import summary

PAD = """
material = { young = 1e6, poisson = 0.4999 }
prescribed_displacement = [{ face = "top", value = [0.0, 0.0, -0.005] }]
contact = { face = "bottom", friction = 0.3 }
[mesh]
box = [1.0, 1.0, 0.5]
cells = [4, 4, 2]
cell = "tetrahedron"
"""

TWO = """
prescribed_displacement = [{ face = "pad:top", value = [0.0, 0.0, -0.005] }]
clamp = [{ face = "base:bottom" }]
contact = { face = "pad:bottom", against = "base:top", friction = 0.3 }
[[body]]
name = "pad"
file = "pad.msh"
material = [{ cells = "soft", young = 1e6, poisson = 0.49 }, { cells = "stiff", young = 1e8, poisson = 0.3 }]
[[body]]
name = "base"
box = [1.0, 1.0, 0.5]
cells = [2, 2, 1]
cell = "tetrahedron"
translate = [0.0, 0.0, -0.5]
material = { young = 1e8, poisson = 0.3 }
"""


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def case_of(text, *changes):
    Path("case.toml").write_text(text)
    return read_case("case.toml", changes)


def orders(case):
    """Order of each body, and what is said of it."""
    problem = case.problem(MPI.COMM_WORLD)
    said = [text for text in problem.body.chosen if "second order" in text]
    return [member.body.degree for member in problem.elasticity.members], said


def test_the_force_is_that_of_second_order_on_finer_hexahedra():
    """To 2 %; with `degree = 1` it is a hundred times as large, as the remark says."""
    solution = case_of(PAD).problem().solve()
    fine = case_of(PAD, 'mesh.cell="hexahedron"', "mesh.cells=[6,6,4]", "mesh.degree=2").problem().solve()
    assert solution.forces["normal_force"] == pytest.approx(fine.forces["normal_force"], rel=0.02)
    entries = summary(solution)
    (said,) = entries["understood"]["chosen"]
    assert "made second order: at Poisson's ratio 0.4999" in said and "degree = 1 in [mesh] keeps" in said
    assert not entries["remarks"]
    kept = case_of(PAD, "mesh.degree=1").problem().solve()
    assert kept.forces["normal_force"] > 50.0 * fine.forces["normal_force"]
    assert any("degree = 2 in [mesh], in Python coulomb.second_order(mesh)" in one for one in summary(kept)["remarks"])


@pytest.mark.parametrize(
    ("changes", "order"),
    [
        ([], 2),
        (["material.poisson=0.45"], 1),
        (['mesh.cell="hexahedron"'], 1),
        (["mesh.degree=1"], 1),
        (['solver.kinematics="large"', 'material={law="mooney-rivlin", c1=1e5, c2=0.0, bulk=1e7}'], 2),
        (['solver.kinematics="large"', 'material={law="mooney-rivlin", c1=1e5, c2=0.0, bulk=1e6}'], 1),
        (["clamp=[{nodes = [[0, 0, 0]]}]"], 1),  # whose lines of nodes would have holes
    ],
)
def test_the_order_of_a_box(changes, order):
    degrees, said = orders(case_of(PAD, *changes))
    assert degrees == [order] and len(said) == order - 1


def test_of_several_bodies_the_one_with_a_soft_group():
    BoxFile((1.0, 1.0, 0.5), (2, 2, 1), "tetrahedron").write(Path("pad.msh"))
    degrees, (said,) = orders(case_of(TWO))
    assert degrees == [2, 1] and "tetrahedra of body 'pad' are made second order" in said and "[[body]]" in said
    assert orders(case_of(TWO, "body.0.degree=1")) == ([1, 1], [])
    BoxFile((1.0, 1.0, 0.5), (2, 2, 1), "tetrahedron").second_order().write(Path("pad.msh"))
    assert orders(case_of(TWO)) == ([2, 1], [])  # as in the file


def test_a_box_too_large_is_refused_with_its_order(monkeypatch):
    monkeypatch.setattr(preparation, "least_room", lambda comm: 1e6)
    with pytest.raises(ValueError, match="a mesh of 4 x 4 x 2 second-order cells has 1215 displacement unknowns"):
        preparation.prepared(case_of(PAD), Path("out"), False)
    BoxFile((1.0, 1.0, 0.5), (2, 2, 1), "tetrahedron").write(Path("pad.msh"))
    monkeypatch.setattr(preparation, "refuse_too_many_cells", lambda *of_a_box: None)
    with pytest.raises(ValueError, match="--force tries nevertheless; tetrahedra of body 'pad' are made second order"):
        preparation.prepared(case_of(TWO), Path("out"), False)


def test_tetrahedra_of_a_deck_stay_as_they_are():
    Path("pad.inp").write_text(
        "*NODE, NSET=N\n1, 0., 0., 0.\n2, 1., 0., 0.\n3, 0., 1., 0.\n4, 0., 0., 1.\n*ELEMENT, TYPE=C3D4, ELSET=E\n"
        "1, 1, 2, 3, 4\n*MATERIAL, NAME=R\n*ELASTIC\n1., 0.4999\n*SOLID SECTION, ELSET=E, MATERIAL=R\n*STEP\n*STATIC\n"
        "*BOUNDARY\n1, 1, 3\n*END STEP\n"
    )
    case = read_case("pad.inp", ['contact=[{face = "x", friction = 0.0}]'])
    assert case.mesh.degree == 1 and case.mesh.mesh(MPI.COMM_WORLD, 0.4999).degree == 1
