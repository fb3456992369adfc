"""Products that are linear solves: only as accurate as needed, and the same answer."""

import numpy as np
from conftest import make_block

from coulomb.solvers import IterativeSolver

MULTIGRID = {"linear_solver": IterativeSolver, "explicit": False}


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
