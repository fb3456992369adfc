"""Products that are linear solves: only as accurate as needed, and the same answer."""

import numpy as np
import pytest
from conftest import make_block
from threadpoolctl import threadpool_info, threadpool_limits

from benchmarks.block import block
from coulomb.model import solving
from coulomb.solvers import DirectSolver, IterativeSolver

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


# --- threads of BLAS beside those of multigrid ---


def _counts():
    """Threads of every BLAS in use that can have several."""
    found = [entry for entry in threadpool_info() if entry["user_api"] == "blas"]
    return [entry["num_threads"] for entry in found if entry.get("threading_layer") != "disabled"]


@pytest.mark.parametrize("solver", [DirectSolver, IterativeSolver])
@pytest.mark.parametrize("team", [1, 2])
def test_multigrid_with_threads_has_the_processors_for_itself(monkeypatch, solver, team):
    monkeypatch.setattr(solving, "threads", lambda: team)
    seen = []
    options = {"explicit": False} if solver is IterativeSolver else {}
    body = block(4, 0.3, linear_solver=solver, **options)
    with threadpool_limits(limits=2, user_api="blas"):
        before = _counts()
        body.solve(progress=lambda _: seen.append(_counts()) and False)
        after = _counts()
    assert before and set(before) == {2}
    assert after == before
    alone = solver is IterativeSolver and team > 1
    assert seen and all(set(counts) == ({1} if alone else {2}) for counts in seen)


def test_as_many_afterwards_as_before_if_a_solve_fails(monkeypatch):
    monkeypatch.setattr(solving, "threads", lambda: 2)
    body = block(4, 0.3, linear_solver=IterativeSolver, explicit=False)
    with threadpool_limits(limits=2, user_api="blas"):
        with pytest.raises(ZeroDivisionError):
            body.solve(progress=lambda _: bool(1 / 0))
        assert set(_counts()) == {2}
