"""Known answers: the independent solver's block, both patch tests, symmetry, units."""

import numpy as np
import pytest
from conftest import STEEL, reference, solved_block

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material, PrescribedDisplacement, Traction
from coulomb.io.summary import summary

FACES = ("left", "right", "front", "back")


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
    assert result["nodes"] == {
        "contact": totals["contact_nodes"],
        "open": totals["open"],
        "stick": totals["stick"],
        "slip": totals["slip"],
    }
    assert result["maximum"]["contact_pressure"] == pytest.approx(totals["max_contact_pressure_Pa"], rel=1e-6)
    assert result["maximum"]["displacement"] == pytest.approx(totals["max_displacement_m"], rel=1e-6)

    surface = solution.problem.surface
    theirs = fields["contact_coordinates"].round(9)
    order, mine = np.lexsort(theirs.T), np.lexsort(surface.x.round(9).T)
    force = -surface.vectors(solution.contact_force.reshape(-1, 3))[mine]
    assert np.allclose(theirs[order], surface.x[mine], atol=1e-8)
    assert np.linalg.norm(force - fields["force_on_body"][order]) <= 1e-5 * np.linalg.norm(force)
    assert np.allclose(surface.area[mine], fields["area"][order], rtol=1e-10)


@pytest.mark.parametrize("p", [8, 12])
@pytest.mark.parametrize("law", ["coulomb", "tresca"])
def test_block_totals_at_other_sizes(p, law):
    totals, _ = reference(p, law)
    result = summary(solved_block(p, law))
    assert result["force_on_body"]["normal"] == pytest.approx(totals["total_normal_force_N"], rel=1e-6)
    assert [result["nodes"][k] for k in ("open", "stick", "slip")] == [totals[k] for k in ("open", "stick", "slip")]


def patch(cells, cell, sides, top, friction):
    """A unit cube on a plane: displacements prescribed on its sides, a traction on top."""
    return ContactProblem(
        coulomb.box((1.0, 1.0, 1.0), cells, cell),
        STEEL,
        [PrescribedDisplacement(face, sides) for face in FACES],
        Contact("bottom", friction=friction),
        [Traction("top", top)],
    )


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_patch_sticking(cell):
    """u_x = (tau/G) z, u_y = 0, u_z = -p z/M is exact: contact forces p area and tau area, no slip."""
    E, nu, p, tau, friction = STEEL.young, STEEL.poisson, 4e7, 1e7, 0.3
    G, M = E / (2 * (1 + nu)), E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))

    def exact(x):
        return np.vstack([tau / G * x[2], 0 * x[0], -p / M * x[2]])

    solution = patch((4, 5, 3), cell, exact, (tau, 0.0, -p), friction).solve(tolerance=1e-10)
    problem, area = solution.problem, solution.problem.surface.area
    assert solution.certificate.passed and len(area) == 3 * 4
    assert np.abs(solution.displacement - exact(problem.elasticity.x.T).T).max() <= 1e-8 * tau / G
    force = -problem.surface.vectors(solution.contact_force.reshape(-1, 3)) / area[:, None]
    assert np.allclose(force, [-tau, 0.0, p], rtol=1e-7, atol=1e-7 * p)
    assert summary(solution)["nodes"] == {"contact": 12, "open": 0, "stick": 12, "slip": 0}


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_patch_sliding_everywhere(cell):
    """u_x = s0 + (nu (1+nu) p/E) x + (F p/G) z, u_y = 0, u_z = -((1-nu^2) p/E) z: all nodes slide along x.

    The iteration starts without friction.  sigma_xx = 0, sigma_yy = -nu p, sigma_zz = -p,
    sigma_xz = F p: the friction on the body is -F p along x.
    """
    E, nu, p, friction, s0 = STEEL.young, STEEL.poisson, 4e7, 0.3, 1e-4
    G = E / (2 * (1 + nu))

    def exact(x):
        return np.vstack(
            [s0 + nu * (1 + nu) * p / E * x[0] + friction * p / G * x[2], 0 * x[0], -(1 - nu**2) * p / E * x[2]]
        )

    solution = patch((4, 5, 3), cell, exact, (friction * p, 0.0, -p), friction).solve(tolerance=1e-10)
    problem, area = solution.problem, solution.problem.surface.area
    assert solution.certificate.passed
    assert np.abs(solution.displacement - exact(problem.elasticity.x.T).T).max() <= 1e-7 * s0
    force = -problem.surface.vectors(solution.contact_force.reshape(-1, 3)) / area[:, None]
    assert np.allclose(force, [-friction * p, 0.0, p], rtol=1e-6, atol=1e-6 * p)
    assert summary(solution)["nodes"] == {"contact": 12, "open": 0, "stick": 0, "slip": 12}


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


def test_gap_not_closed_by_the_load():
    """A plane 1 mm below a block that sags less: no contact, no force, certificate passed."""
    problem = ContactProblem(
        coulomb.box((3.0, 1.0, 1.0), (6, 2, 2)),
        STEEL,
        [Clamp("left"), Clamp("right")],
        Contact("bottom", friction=0.3, foundation=coulomb.Plane((0, 0, -0.1), (0, 0, 1))),
        [Traction("top", (0.0, 0.0, -4e7))],
    )
    solution = problem.solve()
    assert not solution.contact_force.any() and solution.certificate.passed
    assert summary(solution)["nodes"]["open"] == len(problem.surface.nodes)


def test_body_force_presses_the_block_down():
    """A thousand times its own weight, carried by contact and clamp."""
    problem = ContactProblem(
        coulomb.box((3.0, 1.0, 1.0), (6, 2, 2)),
        STEEL,
        [Clamp("left")],
        Contact("bottom", friction=0.3),
        body_force=(0.0, 0.0, -7.8e7),
    )
    solution = problem.solve()
    assert solution.certificate.passed
    assert 0.8 * 3 * 7.8e7 < summary(solution)["force_on_body"]["normal"] < 3 * 7.8e7
