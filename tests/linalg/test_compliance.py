import numpy as np
from conftest import make_block, to_csr
from mpi4py import MPI

import coulomb
from coulomb import Plane
from coulomb.fem.bodies import diagonal_of
from coulomb.linalg.compliance.compliance import estimated_diagonal
from coulomb.linalg.factors.multifrontal import MultifrontalSolver
from coulomb.linalg.solve_errors import CGNotConverged
from coulomb.solvers import DirectSolver, IterativeSolver


def dense(problem):
    """A, b from numpy alone: K and B as dense matrices."""
    K, B = to_csr(problem.elasticity.K).toarray(), to_csr(problem.surface.B).toarray()
    c = np.column_stack([problem.surface.gap, np.zeros((len(problem.surface.gap), 2))]).ravel()
    return B @ np.linalg.solve(K, B.T), B @ np.linalg.solve(K, problem.linear.f.array) - c


def test_schur_complement_is_that_of_dense_algebra():
    """On a tilted plane, so that rows of B mix components."""
    problem = make_block(2, foundation=Plane((0, 0, -1.0), (-0.3, 0.2, 1.0)))
    assert isinstance(problem.body.stiffness.solver, MultifrontalSolver)
    A, _ = dense(problem)
    assert np.allclose(problem.A.dense(), A, rtol=1e-9, atol=1e-11 * A.max())
    assert np.allclose(problem.A.diagonal(), np.diag(A), rtol=1e-9, atol=0.0)


def plate(cells, linear_solver):
    """Held at its left end, lifted at its right one: diag(A) varies by three orders of magnitude along the contact."""
    return coulomb.ContactProblem(
        coulomb.box((0.1, 0.08, 0.004), cells),
        coulomb.Material(7e10, 0.33),
        clamps=[coulomb.Clamp("left")],
        tractions=[coulomb.Traction("right", (1e6, 0.0, 2e5)), coulomb.Traction("top", (0.0, 0.0, -2e4))],
        contact=coulomb.Contact("bottom", 0.4),
        linear_solver=linear_solver,
    )


def test_estimated_diagonal_of_a_plate():
    """Traces alone give an estimate 264 times too large near the clamp, and a negative one on meshes like these."""
    exact, estimate = (plate((20, 16, 2), solver).A.diagonal() for solver in (DirectSolver, IterativeSolver))
    assert exact.max() >= 1e3 * exact.min()
    ratio = estimate / exact
    assert ratio.min() >= 0.4 and ratio.max() <= 25.0
    assert np.sqrt(np.mean(np.log(ratio) ** 2)) <= 0.7


def test_few_products_on_a_plate():
    """21 steps and 266 products with the estimate by traces alone."""
    result = plate((24, 20, 2), IterativeSolver).solve().result
    # 113 to 129 by the kernels of BLAS
    assert result.newton_steps <= 18 and result.products <= 150  # up to 12 settle the forces


class Products:
    """Products by a matrix that are counted, and fail from one on."""

    comm = MPI.COMM_SELF

    def __init__(self, A, fails=99):
        self.A, self.nodes, self.left = A, len(A) // 3, fails

    def mult(self, x, y, tolerance=0.0):
        self.left -= 1
        if self.left < 0:
            raise CGNotConverged(1, 1.0, tolerance, False)
        y[:] = self.A @ x


def test_a_compliance_of_low_rank_is_found_as_it_is():
    """Its diagonal to a thousandth, and next to nothing left; B diag(K)^-1 B^T alone where products fail."""
    problem = make_block(2)
    B, K = problem.surface.B, problem.elasticity.K
    U = np.random.default_rng(72).standard_normal((B.getSize()[0], 3)) * np.array([1.0, 0.1, 0.01]) * 1e-6
    found = estimated_diagonal(Products(U @ U.T), B, diagonal_of(K))
    assert np.abs(found.whole - np.sum(U**2, axis=1)).max() <= 0.01 * np.sum(U**2, axis=1).max()
    assert 0.0 < found.rest.sum() <= 0.01 * found.whole.sum()
    local = to_csr(B).toarray() ** 2 @ (1.0 / to_csr(K).toarray().diagonal())
    for failing in (Products(U @ U.T, 0), Products(U @ U.T, 5), Products(0.0 * U @ U.T)):
        found = estimated_diagonal(failing, B, diagonal_of(K))
        assert np.allclose(found.whole, local) and np.allclose(found.rest, local)


def test_an_estimated_diagonal_is_positive():
    """Also of a component that is much smaller than what others add to it, by chance with either sign."""
    problem = make_block(2)
    B, K = problem.surface.B, problem.elasticity.K
    size = B.getSize()[0]
    scale = np.tile([1.0, 1.0, 1e-3], size // 3)
    for seed in range(8):
        U = scale[:, None] * np.random.default_rng(seed).standard_normal((size, size))
        found = estimated_diagonal(Products(U @ U.T), B, diagonal_of(K))
        assert found.rest.min() > 0.0 and np.all(found.whole > found.rest)
