"""Known answers: the independent solver's block, symmetry, units; patch tests are in `python -m verification`."""

import numpy as np
import pytest
from conftest import STEEL, reference, solved_block

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material, Traction
from coulomb.io.summary import summary


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("p", [6, 10])
def test_block_against_the_independent_solver(p, law):
    totals, fields = reference(p, law)
    solution = solved_block(p, law)
    result = summary(solution)
    on_body, expected = result["force_on_body"], totals["tangential_force_on_body_N"]
    assert result["certificate"]["passed"]
    assert on_body["normal"] == pytest.approx(totals["total_normal_force_N"], rel=1e-6)
    assert np.linalg.norm(np.subtract(on_body["tangential"], expected)) <= 1e-6 * np.linalg.norm(expected)
    counts = {name: totals[name] for name in ("open", "stick", "slip")}
    assert result["nodes"] == {"contact": totals["contact_nodes"], **counts}
    assert result["maximum"]["contact_pressure"] == pytest.approx(totals["max_contact_pressure_Pa"], rel=1e-6)
    assert result["maximum"]["displacement"] == pytest.approx(totals["max_displacement_m"], rel=1e-6)

    surface = solution.problem.surface
    theirs = fields["contact_coordinates"].round(9)
    order, mine = np.lexsort(theirs.T), np.lexsort(surface.x.round(9).T)
    force = -surface.vectors(solution.contact_force.reshape(-1, 3))[mine]
    assert np.allclose(theirs[order], surface.x[mine], atol=1e-8)
    assert np.linalg.norm(force - fields["force_on_body"][order]) <= 1e-5 * np.linalg.norm(force)
    assert np.allclose(surface.area[mine], fields["area"][order], rtol=1e-10)


def test_mirror_symmetry():
    """Without the load along y, the problem is its own mirror image in y = 1/2: so is the answer."""
    p = 5
    problem = ContactProblem(
        coulomb.box((3.0, 1.0, 1.0), (3 * p, p, p)),
        STEEL,
        [Clamp("left")],
        Contact("bottom", friction=0.3),
        [Traction("top", (0.0, 0.0, -4e7)), Traction("right", (2e7, 0.0, 0.0))],
    )
    solution = problem.solve()
    x = problem.surface.x.round(9)
    mirrored = np.column_stack([x[:, 0], 1.0 - x[:, 1], x[:, 2]]).round(9)
    image = np.lexsort(mirrored.T)[np.argsort(np.lexsort(x.T))]
    force = problem.surface.vectors(solution.contact_force.reshape(-1, 3))
    assert np.abs(force[image] * [1, -1, 1] - force).max() <= 1e-6 * np.abs(force).max()


def test_newton_metre_against_kilonewton_millimetre():
    """Units change the numbers, not the answer, and not the work: steel in kN and mm."""
    p = 4
    si = solved_block(p)
    other = ContactProblem(
        coulomb.box((3000.0, 1000.0, 1000.0), (3 * p, p, p)),
        Material(STEEL.young * 1e-9, STEEL.poisson),
        [Clamp("left")],
        Contact("bottom", friction=0.3),
        [Traction("top", (0.0, 1e-2, -4e-2)), Traction("right", (2e-2, 0.0, 0.0))],
    ).solve()
    assert np.linalg.norm(1e3 * other.contact_force - si.contact_force) <= 1e-7 * np.linalg.norm(si.contact_force)
    assert np.linalg.norm(1e-3 * other.displacement - si.displacement) <= 1e-7 * np.linalg.norm(si.displacement)
    assert other.result.newton_steps == si.result.newton_steps
    assert other.certificate.passed
