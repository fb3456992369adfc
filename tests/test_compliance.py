import numpy as np
import pytest
from conftest import make_block
from scipy.sparse import csr_array

from coulomb import AugmentedSystem, DirectSolver, InteriorPoint, IterativeSolver, Plane
from coulomb.benchmarks.by_columns import compliance_by_columns
from coulomb.linalg.multifrontal import MultifrontalSolver


def to_numpy(matrix):
    indptr, indices, values = matrix.getValuesCSR()
    return csr_array((values, indices, indptr), shape=matrix.getSize()).toarray()


def dense(problem):
    """A, b from numpy alone: K and B as dense matrices."""
    K, B = to_numpy(problem.elasticity.K), to_numpy(problem.surface.B)
    c = np.column_stack([problem.surface.gap, np.zeros((len(problem.surface.gap), 2))]).ravel()
    return B @ np.linalg.solve(K, B.T), B @ np.linalg.solve(K, problem.f.array) - c


@pytest.mark.parametrize(
    "options",
    [{}, {"explicit": False, "linear_solver": DirectSolver}, {"linear_solver": IterativeSolver}],
    ids=["explicit", "matrix-free", "iterative"],
)
def test_product_and_b(options):
    problem = make_block(2, **options)
    A, b = dense(problem)
    x = np.random.default_rng(71).standard_normal(len(b))
    y = np.empty_like(x)
    before = problem.A.products
    problem.A.mult(x, y)
    assert problem.A.products == before + 1
    assert np.linalg.norm(y - A @ x) <= 1e-9 * np.linalg.norm(y)
    assert np.linalg.norm(problem.b - b) <= 1e-9 * np.linalg.norm(b)


def test_schur_complement_is_that_of_dense_algebra():
    """On a tilted plane, so that rows of B mix components."""
    problem = make_block(2, foundation=Plane((0, 0, -1.0), (-0.3, 0.2, 1.0)))
    assert isinstance(problem.body.stiffness_solver, MultifrontalSolver)
    A, _ = dense(problem)
    assert np.allclose(problem.A.dense(), A, rtol=1e-9, atol=1e-11 * A.max())
    assert np.allclose(problem.A.diagonal(), np.diag(A), rtol=1e-9, atol=0.0)


def test_blocks_of_columns_fit_together(monkeypatch):
    """The benchmark's other method: A by right-hand sides."""
    monkeypatch.setattr("coulomb.benchmarks.by_columns._COLUMNS_AT_ONCE", 7)
    problem = make_block(2)
    A, _ = dense(problem)
    formed = compliance_by_columns(problem.surface.B, DirectSolver(problem.elasticity.K))
    assert np.allclose(formed, A, rtol=1e-10, atol=1e-12 * A.max())


def test_estimated_diagonal_needs_few_more_products():
    """The estimate depends on the neighbourhood of a node, not its position: CG with P_AM needs few more products."""
    exact, estimated = make_block(4, slip_stress=1e7), make_block(4, slip_stress=1e7, explicit=False)
    assert estimated.A.diagonal().sum() == pytest.approx(exact.A.diagonal().sum(), rel=0.5)
    paper = InteriorPoint(newton=AugmentedSystem(rank=0))
    a, b = exact.solve(solver=paper).result, estimated.solve(solver=paper).result
    assert np.linalg.norm(a.x - b.x) <= 1e-6 * np.linalg.norm(a.x)
    assert sum(s.krylov for s in b.history) <= 1.25 * sum(s.krylov for s in a.history)
    recycled = (
        estimated.solve().result
    )  # the low-rank approximation still saves products; the estimate costs a few more
    assert sum(s.krylov for s in recycled.history) < sum(s.krylov for s in b.history)


def test_displacement_of_given_forces():
    """u = K^-1 (f - B^T x): pressing up lifts the block."""
    problem = make_block(2)
    x = np.zeros(3 * len(problem.surface.nodes))
    free = problem.displacement(x)
    x[0::3] = 1e6
    lifted = problem.displacement(x) - free
    assert lifted[problem.surface.nodes, 2].min() > 0.0
    gradient = problem.surface.components(-(free + lifted)[problem.surface.nodes])
    A, b = dense(problem)
    assert np.allclose(gradient.ravel(), A @ x - b, rtol=1e-8, atol=1e-10 * np.abs(b).max())
