"""CONVERGED refers to the residual with a fresh product, for every solver and Newton system."""

import dataclasses
import functools

import numpy as np
import pytest
from conftest import dense_compliance, make_block, random_spd, solved_block
from shared_problems import residual_of

from coulomb import InteriorPoint, NotConverged, Status, SuccessiveTresca
from coulomb.linalg.compliance.low_rank import RecycledColumns
from coulomb.solvers import (
    KPRGP,
    AugmentedSystem,
    Automatic,
    CondensedSystem,
    DenseSystem,
    FrictionProblem,
    IterativeSolver,
    SchurComplementSystem,
)
from coulomb.solvers.kprgp import norm_of

TOLERANCE = 1e-8
QP = {
    "P_AM with low rank": InteriorPoint(TOLERANCE),
    "P_AM": InteriorPoint(TOLERANCE, newton=AugmentedSystem(rank=0)),
    "P_SC": InteriorPoint(TOLERANCE, newton=SchurComplementSystem(rank=0)),
    "LU": InteriorPoint(TOLERANCE, newton=DenseSystem()),
    "condensed": InteriorPoint(TOLERANCE, newton=CondensedSystem()),
    "KPRGP": KPRGP(TOLERANCE),
}
COULOMB = {
    "auto": Automatic(TOLERANCE),
    "interior point": InteriorPoint(TOLERANCE),
    "interior point, LU": InteriorPoint(TOLERANCE, newton=DenseSystem()),
    "interior point, condensed": InteriorPoint(TOLERANCE, newton=CondensedSystem()),
    **{f"successive Tresca, {name}": SuccessiveTresca(TOLERANCE, solver) for name, solver in QP.items()},
}
FORMED = {"LU", "interior point, LU", "successive Tresca, LU"}  # need the matrix A
CONDENSED = {"condensed", "interior point, condensed", "successive Tresca, condensed"}  # need K
DEAR = {
    "successive Tresca, P_AM",
    "successive Tresca, P_SC",
    "successive Tresca, KPRGP",
    "KPRGP",
}  # many products, each a solve


@functools.cache
def block(law):
    """The block with products by multigrid, and the exact A from the factorised one."""
    problem = make_block(4, slip_stress=1e7 if law == "tresca" else None, linear_solver=IterativeSolver, explicit=False)
    exact = solved_block(4, law).problem
    return problem, exact.A.dense(), exact.b


def is_fresh(result, A, b, bound, accuracy=1e-12, d=None):
    fresh = residual_of(A, b, bound, result.x, d is not None, d)  # an estimate of diag(A) where A is not formed
    error = np.linalg.norm(result.gradient - (A @ result.x - b))
    # the projection does not expand: the residual differs by |error of A x| / (a s) at most, s a contact's scale
    inexact = error / (np.diag(A).min() * 1e-2 * np.linalg.norm(result.x.reshape(-1, 3), axis=1).max())
    assert fresh <= 1.01 * (TOLERANCE + inexact) or result.status is not Status.CONVERGED
    assert result.residual == pytest.approx(fresh, rel=0.02, abs=max(1e-3 * TOLERANCE, 1.01 * inexact))
    assert error <= accuracy * np.linalg.norm(b)


@pytest.mark.parametrize("name", [name for name in COULOMB if name not in FORMED | DEAR])
def test_coulomb_by_multigrid(name):
    """Products that are solves: exact to 1e-11 at the end, to a few hundredths before."""
    problem, A, b = block("coulomb")
    result = COULOMB[name].solve(problem.friction_problem)
    is_fresh(result, A, b, lambda x_n: 0.3 * np.maximum(x_n, 0.0), 1e-10, problem.A.diagonal())
    own = problem.friction_problem.residual(result.x, result.gradient)
    assert own == pytest.approx(result.residual, rel=1e-6)  # of the forces and the gradient that are returned


@pytest.mark.parametrize("name", [name for name in QP if name not in FORMED | DEAR])
def test_tresca_by_multigrid(name):
    problem, A, b = block("tresca")
    g = problem.slip_bound(problem.b)
    is_fresh(QP[name].solve(problem.tresca(g)), A, b, lambda _: g, 1e-10, problem.A.diagonal())


class Sloppy:
    """A x as inexact as the caller allows, in a random direction; the caller must not rely on it.

    Args:
        A: The matrix.
        once: Number, from 1, and size of the error of one product that is wrong; none by default.

    `mult_incremental` corrects the last product, error and all, as multigrid does.
    """

    name = "sloppy"
    exact = False
    matrix_free = None

    def __init__(self, A, once=(0, 0.0)):
        self._A, self._once = A, once
        self._formed = dense_compliance(A)
        self.comm, self.nodes, self.products = self._formed.comm, len(A) // 3, 0
        self.learnt = RecycledColumns()
        self._last, self._rng = np.zeros(len(A)), np.random.default_rng(4)

    def mult(self, x, y, tolerance=0.0):
        self.products += 1
        tolerance = self._once[1] if self.products == self._once[0] else tolerance
        y[:] = self._off(self._A @ x, 0.0, tolerance)

    def mult_incremental(self, x, y, tolerance=0.0):
        self.products += 1
        y[:] = self._last = self._off(self._A @ x, self._last, tolerance)

    def _off(self, exact, last, tolerance):
        error = self._rng.standard_normal(len(exact))
        return exact + tolerance * np.linalg.norm(exact - last) / np.linalg.norm(error) * error

    def diagonal(self):
        return np.diag(self._A).copy()

    def dense(self):
        return self._A


def hard(seed, nodes=12, condition=1e3):
    rng = np.random.default_rng(seed)
    A = 1e-9 * random_spd(3 * nodes, condition, rng)
    b = 1e-4 * rng.standard_normal(3 * nodes)
    b[0::3] += 5e-5
    return A, b


def answers(solver, pose):
    """Three problems; answers not converged are checked by a fresh product as well; at most one is not converged."""
    given_up = 0
    for seed in range(3):
        A, b = hard(seed)
        try:
            result = solver.solve(pose(A, b, seed))
        except NotConverged as failure:
            result, given_up = failure.result, given_up + 1
        yield A, b, seed, result
    assert given_up <= 1


def bounds(seed):
    return np.random.default_rng(seed).uniform(0.1, 1.0, 12) * 1e4


@pytest.mark.parametrize("name", [name for name in COULOMB if name not in CONDENSED])
def test_coulomb_with_products_as_inexact_as_allowed(name):
    for A, b, _, result in answers(
        COULOMB[name], lambda A, b, _: FrictionProblem.coulomb(Sloppy(A), b, np.full(12, 0.4))
    ):
        is_fresh(result, A, b, lambda x_n: 0.4 * np.maximum(x_n, 0.0))


@pytest.mark.parametrize("name", [name for name in QP if name not in CONDENSED])
def test_tresca_with_products_as_inexact_as_allowed(name):
    for A, b, seed, result in answers(QP[name], lambda A, b, seed: FrictionProblem.tresca(Sloppy(A), b, bounds(seed))):
        is_fresh(result, A, b, lambda _, g=bounds(seed): g)


@pytest.mark.parametrize("name", ["P_AM with low rank", "interior point", "interior point, condensed"])
def test_interrupted_answers_have_a_fresh_residual(name):
    """Stopped before convergence, by multigrid: A x of the last step is accurate to a few hundredths of that step."""
    if name in QP:
        problem, A, b = block("tresca")
        posed, g = problem.friction_problem, problem.slip_bound(problem.b)
    else:
        problem, A, b = block("coulomb")
        posed, g = problem.friction_problem, None
    solver = dataclasses.replace({**QP, **COULOMB}[name], max_iterations=5)
    with pytest.raises(NotConverged) as failure:
        solver.solve(posed)
    law = (lambda x_n: 0.3 * np.maximum(x_n, 0.0)) if g is None else lambda _: g
    is_fresh(failure.value.result, A, b, law, 1e-8, problem.A.diagonal())


@pytest.mark.parametrize("product", [3, 8, 12, 16])
@pytest.mark.parametrize("name", [name for name in QP if name not in CONDENSED])
def test_one_wrong_product_is_detected(name, product):
    """Incremental products of the solver stay wrong; the residual for CONVERGED must not use them.

    All nodes stick: no face is left and no constraint met, which would make KPRGP compute its gradient anew.
    """
    A, b = hard(11, condition=30.0)
    x = np.random.default_rng(11).uniform(1e4, 2e4, len(b))
    b, g = A @ x, np.full(len(b) // 3, 1e5)
    if name == "KPRGP":  # which begins by finding |A|
        probe = FrictionProblem.tresca(Sloppy(A), b, g)
        norm_of(probe)
        product += probe.A.products
    result = QP[name].solve(FrictionProblem.tresca(Sloppy(A, (product, 1e-4)), b, g))
    is_fresh(result, A, b, lambda _: g)
