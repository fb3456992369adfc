"""Factors in place of multigrid, and multigrid on soft springs: the same on all ranks."""

import numpy as np
import pytest
from conftest import STEEL
from mpi4py import MPI
from shared_problems import two_bodies
from test_thin_bodies import CELLS, sheet

import coulomb
from coulomb import Elasticity, NotConverged, Spring
from coulomb.linalg.compliance import predicted_cost as methods
from coulomb.linalg.compliance import stiffness
from coulomb.linalg.reductions import Reductions
from coulomb.model import contact_stiffness
from coulomb.solvers import CondensedSystem, DirectSolver, IterativeSolver

RANK = MPI.COMM_WORLD.rank


@pytest.fixture(autouse=True)
def by_multigrid(monkeypatch):
    """Multigrid is chosen, and fails after 30 iterations."""
    monkeypatch.setattr(contact_stiffness, "undecided", lambda _, __, *given: given == (None, None))
    monkeypatch.setattr(contact_stiffness, "worth", lambda *_: np.inf)
    monkeypatch.setattr(stiffness, "_ITERATIONS", 30)


@pytest.mark.parametrize("slow", [False, True])
def test_all_ranks_change(monkeypatch, slow):
    """Where each rank by itself would allow another number of iterations."""
    if slow:
        monkeypatch.setattr(contact_stiffness, "patience", lambda *_: 20.0 + 300.0 * RANK)
    problem = sheet(CELLS)
    assert problem.body.stiffness.linear_solver is IterativeSolver
    solution = problem.solve()
    assert problem.body.stiffness.linear_solver is DirectSolver and solution.certificate.passed
    assert len(set(MPI.COMM_WORLD.allgather(problem.body.stiffness.present.why))) == 1
    assert ("and after 20 factors" in problem.body.stiffness.present.why) is slow
    exact, over = sheet(CELLS, linear_solver=DirectSolver).solve(), Reductions(MPI.COMM_WORLD)
    assert over.max(np.abs(solution.displacement - exact.displacement)) < 1e-6 * over.max(np.abs(exact.displacement))


@pytest.mark.parametrize("formed", [True, False])
def test_a_sheet_is_condensed(monkeypatch, formed):
    """After some products by a formed A, or from the beginning, on all ranks."""
    exact, over = sheet(CELLS, linear_solver=DirectSolver).solve(), Reductions(MPI.COMM_WORLD)
    monkeypatch.setattr(contact_stiffness, "_PRODUCTS", 3)
    if not formed:
        monkeypatch.setattr(methods, "EXPLICIT_UP_TO", 0)
    problem = sheet(CELLS, linear_solver=DirectSolver)
    solution = problem.solve()
    assert (
        problem.body.stiffness.present.newton is CondensedSystem
        and ("too many Krylov iterations" in problem.body.stiffness.present.why) is formed
    )
    assert solution.certificate.passed and solution.result.method == "interior point"
    assert over.max(np.abs(solution.displacement - exact.displacement)) < 1e-6 * over.max(np.abs(exact.displacement))


def test_no_rank_changes(monkeypatch):
    """The memory is too small in the opinion of the first rank only; the others follow."""
    fits = contact_stiffness.fits
    monkeypatch.setattr(contact_stiffness, "fits", lambda *given: RANK > 0 and fits(*given))
    problem = sheet(CELLS)
    with pytest.raises(NotConverged, match="failed: after 30 iterations"):
        problem.solve()
    assert problem.body.stiffness.linear_solver is IterativeSolver and not problem.body.stiffness.present.why


def test_a_body_on_soft_springs():
    """As many products as on one rank, and springs and contact carry the load of 3.2 MN.  With springs of 3e6 N/m^3 and
    less the interior-point method may end above the tolerance on several ranks."""
    solution = two_bodies(1e7, linear_solver=IterativeSolver).solve()
    assert solution.certificate.passed and solution.result.products <= 300
    over, x = Reductions(MPI.COMM_WORLD), solution.contact_force.reshape(-1, 3)
    spring = -solution.problem.elasticity.spring_force(solution.displacement)
    assert over.sum(x[:, 0]) - over.sum(spring[:, 2]) == pytest.approx(3.2e6, rel=1e-9)
    assert np.all(x[:, 0] >= 0.0)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_springs_are_integrated_and_are_those_of_the_stiffness(cell, degree):
    """The energy of a tilted face is stiffness times its inertia; K u is internal forces less those of the springs."""
    mesh = coulomb.box((1.0, 2.0, 0.5), (3, 4, 2), cell, degree=degree)
    body = Elasticity(mesh, STEEL, [], springs=[Spring("bottom", (0.0, 0.0, 3e9)), Spring("left", 1e9)])
    over = Reductions(MPI.COMM_WORLD)
    tilted = np.zeros_like(body.x)
    tilted[:, 2] = body.x[:, 0]
    bottom, left = body.spring_forces(tilted)
    assert over.sum(-bottom.forces * tilted) == pytest.approx(3e9 * 2.0 / 3.0, rel=1e-12)
    assert over.max(np.abs(left.forces)) <= 1e-12 * over.max(np.abs(bottom.forces))
    u = np.sin(body.x @ [[7.0, 3.0, 5.0], [2.0, 9.0, 4.0], [6.0, 1.0, 8.0]])
    given, product = body.K.createVecs()
    given.array[:] = u.ravel()
    body.K.mult(given, product)
    off = product.array.reshape(-1, 3) - body.internal_force(u) + body.spring_force(u) - body.anchoring * u
    assert over.max(np.abs(off)) <= 1e-12 * over.max(np.abs(product.array))
