"""Products that are linear solves: only as accurate as needed, and the same answer."""

import numpy as np
import pytest
from conftest import make_block, solved_block

import coulomb
from coulomb import InteriorPoint, SuccessiveTresca
from coulomb.solvers import IterativeSolver

MULTIGRID = {"linear_solver": IterativeSolver, "explicit": False}


@pytest.mark.parametrize(
    ("law", "solver"),
    [
        ("coulomb", InteriorPoint(1e-8)),
        ("coulomb", SuccessiveTresca(1e-8)),
        ("tresca", InteriorPoint(1e-8)),
        ("tresca", InteriorPoint(1e-8, newton=coulomb.solvers.SchurComplementSystem(rank=0))),
    ],
    ids=["interior point", "successive Tresca", "path following", "path following, P_SC"],
)
def test_inexact_products_same_answer(law, solver):
    exact = solved_block(6, law)
    problem = make_block(6, slip_stress=1e7 if law == "tresca" else None, **MULTIGRID)
    solution = problem.solve(solver=solver)
    assert not problem.A.exact and solution.certificate.passed
    assert np.linalg.norm(solution.contact_force - exact.contact_force) <= 1e-6 * np.linalg.norm(exact.contact_force)


def test_multigrid_iterations_of_the_whole_problem():
    """A solve to 1e-11 takes 24; the products of the interior-point method take about 4 each on average."""
    problem = make_block(8, **MULTIGRID)
    result = problem.solve(1e-7).result
    assert result.newton_steps <= 24 and result.products <= 110
    assert problem.body.stiffness.solver.iterations <= 4.5 * result.products  # 3.7 to 4.1 for p = 8 to 20


def test_incremental_products_do_not_accumulate_errors():
    """After a hundred small increments, each accurate to 10 %, the error is that of one."""
    problem = make_block(4, **MULTIGRID)
    A, n = problem.A, 3 * len(problem.surface.nodes)
    rng = np.random.default_rng(91)
    x, y, exact = rng.standard_normal(n), np.empty(n), np.empty(n)
    A.mult_incremental(x, y)
    for _ in range(100):
        move = 1e-3 * rng.standard_normal(n)
        x = x + move
        A.mult_incremental(x, y, 0.1)
    A.mult(x, exact)
    A.mult(move, step := np.empty(n))
    assert np.linalg.norm(y - exact) <= 0.5 * np.linalg.norm(step)
    A.mult_incremental(x, y)
    assert np.linalg.norm(y - exact) <= 1e-8 * np.linalg.norm(exact)


def test_a_loose_product_costs_less():
    problem = make_block(4, **MULTIGRID)
    A, solver = problem.A, problem.body.stiffness.solver
    rng, y = np.random.default_rng(92), np.empty(3 * len(problem.surface.nodes))
    counts = []
    for tolerance in (0.1, 1e-3, 0.0):  # of a new vector each time: a solve starts from the last ones
        x = rng.standard_normal(len(y))
        before = solver.iterations
        A.mult(x, y, tolerance)
        counts.append(solver.iterations - before)
    assert counts[0] < counts[1] < counts[2] and counts[0] <= counts[2] / 3
