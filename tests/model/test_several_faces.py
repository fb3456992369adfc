"""Several contact faces: a block between two jaws."""

import numpy as np
import pytest
from conftest import STEEL
from shared_problems import CLOSING, CORK, jaws

import coulomb
from coulomb import Clamp, Contact, ContactProblem, LoadHistory, Spring
from coulomb.io.output import write
from coulomb.recheck import check


def test_squeezed_and_sheared():
    """E d/h on each face; the plate drags the block with it by friction, all nodes slip on the weaker face."""
    first, second = (step.solution for step in LoadHistory([1.0, 2.0], tolerance=1e-10).steps(jaws((0.4, 0.2))))
    assert first.certificate.passed and second.certificate.passed
    bottom, top = first.at_nodes.totals(0), first.at_nodes.totals(1)
    pressed = 1e7 * 1e-3 / 0.05 * 0.01  # N
    assert bottom["force"] == pytest.approx([0.0, 0.0, pressed], rel=1e-4, abs=1e-6 * pressed)  # springs take 1e-5
    assert top["force"] == pytest.approx([0.0, 0.0, -pressed], rel=1e-4, abs=1e-6 * pressed)
    assert first.at_nodes.totals()["force"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-4 * pressed)
    assert bottom["centre_of_pressure"] == pytest.approx([0.05, 0.05, 0.0], abs=1e-6)
    assert bottom["moment"] == pytest.approx([0.05 * pressed, -0.05 * pressed, 0.0], rel=1e-4, abs=1e-6 * pressed)
    assert first.at_nodes.totals()["contact_area"] == pytest.approx(0.02)
    assert bottom["contact_area"] == pytest.approx(0.01)
    bottom, top = second.at_nodes.totals(0), second.at_nodes.totals(1)
    assert top["force"][0] == pytest.approx(0.2 * top["normal_force"], rel=1e-8)  # with the plate
    assert bottom["force"][0] == pytest.approx(-top["force"][0], rel=1e-3)
    assert bottom["faces"] == ["bottom"] and second.at_nodes.totals()["faces"] == ["bottom", "top"]


def test_the_order_of_the_faces_does_not_matter():
    one = jaws(motion=CLOSING[:2])
    other = ContactProblem(one.mesh, CORK, [], one.contacts[::-1], springs=[Spring("left", 1e3), Spring("right", 1e3)])
    a, b = (next(iter(LoadHistory([1.0], tolerance=1e-10).steps(problem))).solution for problem in (one, other))
    # 2000 N pass by springs of 10 N/m in all: 1e-10 of the forces moves the block by 2e-8 m
    assert np.allclose(a.displacement, b.displacement, rtol=0.0, atol=2e-8)
    # and the springs make the mean of diag(A), the scale of the residual, 1e4 times that of the cork
    assert a.at_nodes.totals(0)["normal_force"] == pytest.approx(b.at_nodes.totals(1)["normal_force"], rel=1e-5)


def test_matrix_free_and_written(tmp_path):
    """The same forces by multigrid; `coulomb check` passes; a line of history.csv has both faces."""
    direct, free = jaws(), jaws(linear_solver=coulomb.solvers.IterativeSolver, explicit=False)
    files = coulomb.HistoryFiles(tmp_path)
    LoadHistory([1.0, 1.5], tolerance=1e-11).run(direct, files)
    _, last = LoadHistory([1.0, 1.5], tolerance=1e-11).steps(free)  # no step is halved
    assert files.rows[-1]["top_force_x"] == pytest.approx(last.solution.at_nodes.totals(1)["force"][0], rel=1e-7)
    assert files.rows[-1]["bottom_force_x"] + files.rows[-1]["top_force_x"] == pytest.approx(
        files.rows[-1]["force_x"], abs=1e-6
    )
    assert check(tmp_path / "steps" / "0002").passed
    write(last.solution, tmp_path / "single")
    assert check(tmp_path / "single").passed


def test_energy_with_one_jaw_moving():
    """All work is done by the plate, none by the floor."""
    *_, last = LoadHistory(np.linspace(0, 2, 17)[1:]).steps(jaws())
    energy = last.state.energy
    assert energy.loads == energy.prescribed == 0.0
    assert abs(energy.imbalance) <= 0.02 * energy.foundation


def test_pressed_into_a_corner(tmp_path):
    """Without friction the stress is uniform: nodes of the edge touch floor and wall, each with its own pressure."""
    contacts = [Contact("bottom", 0.0), Contact("right", 0.0)]
    loads = [coulomb.Pressure("top", 1e6), coulomb.Pressure("left", 2e6)]
    problem = ContactProblem(coulomb.box((1.0, 1.0, 1.0), (3, 3, 3)), STEEL, [Clamp("front", "y")], contacts, loads)
    solution = problem.solve()
    at, nodes = solution.at_nodes, problem.surface.nodes
    assert solution.valid and len(nodes) == 32 and len(np.unique(nodes)) == 28
    for part, pressure in enumerate((1e6, 2e6)):
        assert at.pressure[at.part == part] == pytest.approx(pressure, rel=1e-6)
    write(solution, tmp_path)
    assert check(tmp_path).passed


@pytest.mark.parametrize(
    ("contacts", "message"),
    [
        ([], "contact must be a Contact, or several, but is"),
        ([Contact("bottom", 0.3)] * 2, "contact faces 'bottom', 'bottom': a node touches the same plane on both"),
    ],
)
def test_bad_faces(contacts, message):
    mesh = coulomb.box((1.0, 1.0, 1.0), (2, 2, 2))
    with pytest.raises(ValueError, match=message):
        ContactProblem(mesh, STEEL, [Clamp("left")], contacts)
