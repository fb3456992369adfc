"""Refinement of solves with inaccurate factors, where the error of these is known: K is a diagonal."""

import numpy as np
import pytest
from petsc4py import PETSc

from coulomb.linalg.factors import MultifrontalSolver, multifrontal

N = 120
D = 10.0 ** np.random.default_rng(1).uniform(-8, 8, N)
"""Stiffnesses of unlike unknowns."""


@pytest.fixture
def Solver(monkeypatch):
    """Of K with factors that make of K^-1, in single precision, this times a factor per unknown."""

    class Factors:
        def __init__(self, nodal, fronts, dtype):
            self.dtype = np.dtype(dtype)

        def solve(self, rhs):
            return (rhs.ravel() * (self.single if self.dtype == np.float32 else 1.0) / D).reshape(rhs.shape)

    def solver(factor):
        Factors.single = factor
        K = PETSc.Mat().createAIJ((N, N), nnz=1, comm=PETSc.COMM_SELF)
        for row, value in enumerate(D):
            K.setValue(row, row, value)
        K.assemble()
        return MultifrontalSolver(K, np.arange(N, dtype=float).reshape(-1, 3), np.empty(0, np.int64), single=True)

    monkeypatch.setattr(multifrontal, "FrontalFactors", Factors)
    return solver


def forces(seed=2):
    """As large for each unknown, in the norm of D^-1/2."""
    return np.sqrt(D) * np.random.default_rng(seed).standard_normal(N)


def test_conjugate_gradients(Solver):
    """Two different errors of the factors take two iterations, where simple refinement would take tens."""
    solver, f = Solver(np.where(np.arange(N) % 2, 1.0, 0.9)), forces()
    u, left = solver.improved(f, np.zeros(N), 0.0)
    assert solver.refinements == 2 and solver.single and left <= 1e-14
    assert np.allclose(u, f / D, rtol=1e-13)
    near, left = solver.improved(f, 1.001 * f / D, 0.5)  # only what is left over is solved for
    assert solver.refinements == 3 and left <= 0.5 and np.linalg.norm((near * D - f) / np.sqrt(D)) <= 0.1


def test_the_error_does_not_depend_on_the_units_of_unknowns(Solver):
    solver, f = Solver(1.0 + 1e-3 * np.random.default_rng(3).standard_normal(N)), forces()
    u, left = solver.improved(f, np.zeros(N), 0.01)
    error = np.linalg.norm((D * u - f) / np.sqrt(D)) / np.linalg.norm(f / np.sqrt(D))
    assert solver.refinements == 1 and error == pytest.approx(left, rel=1e-6) and 1e-4 < error < 2e-3
    easy = np.where(np.arange(N) == 5, f, 0.0)  # exact after one iteration
    hardest = solver.error
    solver.improved(easy, np.zeros(N), 0.0)
    assert solver.error == hardest == pytest.approx(error, rel=1e-6)


def test_slow_refinement_ends_in_double_precision(Solver):
    """From an approximation, whose residual alone is solved for."""
    solver, f = Solver(np.random.default_rng(4).uniform(0.02, 1.0, N)), forces()
    assert solver.single
    u, _ = solver.improved(f, 1.5 * f / D, 0.0)
    assert not solver.single and solver.exact and solver.error == 0.0 and solver.refinements <= 6
    assert np.allclose(u, f / D, rtol=1e-14)
