"""Conjugate gradients with products in single precision: used where their errors are small beside the tolerance."""

import numpy as np
from mpi4py import MPI

from coulomb.linalg.multigrid.block_matrix import padded
from coulomb.linalg.multigrid.recycled_cg import RecycledCG

N, ERROR = 64, 1e-5
K = 2.0 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1)  # eigenvalues from 2e-3 to 4
SMOOTH, UNEVEN = np.ones(N), (-1.0) ** np.arange(N)


class Rough:
    """Products by K with errors of a part ERROR of its diagonal."""

    def __init__(self):
        self.products = 0

    def mult_roughly(self, x, y):
        y[:] = K @ x + ERROR * UNEVEN * 2.0 * x
        self.products += 1

    def rounding(self, x):
        return float(np.sum((ERROR * 2.0 * x) ** 2))


def solved(rhs, tolerance=0.03):
    """The residual of a second solve, and its products in single precision."""
    rough = Rough()

    def mult(x, y):
        y[:] = K @ x

    cg = RecycledCG(MPI.COMM_SELF, N, mult, lambda r: 0.5 * r, rough=rough)
    u = padded(N)
    cg.solve(UNEVEN * (1.0 + np.arange(N) / N), u, tolerance)
    assert rough.products == 0  # nothing is known about the solution of a first solve
    cg.solve(rhs, u, tolerance)
    return float(np.linalg.norm(rhs - K @ u) / np.linalg.norm(rhs)), rough.products


def test_rough_products_where_they_are_accurate_enough():
    residual, products = solved(UNEVEN * np.cos(np.arange(N) / 9.0))
    assert residual <= 0.03 and products > 0


def test_accurate_products_to_many_digits():
    residual, products = solved(UNEVEN * np.cos(np.arange(N) / 9.0), 1e-6)
    assert residual <= 1e-6 and products == 0


def test_the_end_of_a_solve_is_accurate_where_the_start_did_not_show_that_it_has_to_be():
    """The solution is smooth and large, but the start, a combination of earlier solutions, has little of it."""
    residual, products = solved(SMOOTH, 1e-3)
    assert residual <= 1e-3 and products > 0
