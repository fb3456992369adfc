"""The low-rank approximation of A against A; its preconditioner against Theorem 1; and the products it saves."""

import numpy as np
import pytest
from conftest import dense_compliance, random_spd
from mpi4py import MPI

from benchmarks.table1 import PAPER, measure
from coulomb.linalg.compliance.low_rank import LowRankApproximation, LowRankUpdate
from coulomb.solvers import AugmentedSystem
from coulomb.solvers.linearization import Linearization
from coulomb.solvers.newton_systems import NewtonEquations, augmented_matrix
from coulomb.solvers.scaled_problem import ScaledCompliance

NODES = 12


@pytest.fixture
def A():
    return random_spd(3 * NODES, 1e4, np.random.default_rng(61))


def approximated_by(A, X, rank, exact=False, replaced=0.0):
    recycled = LowRankApproximation(MPI.COMM_SELF, np.diag(A).reshape(-1, 3).copy(), rank, exact, replaced)
    for x in X:
        recycled.record(x.reshape(-1, 3), (A @ x).reshape(-1, 3))
    recycled.update()
    return recycled


def test_rank_zero_is_the_papers_diagonal(A):
    recycled = approximated_by(A, [], 100)
    assert recycled.U.shape == (3 * NODES, 0) and np.array_equal(recycled.rest.ravel(), np.diag(A))
    assert approximated_by(A, np.eye(3 * NODES), 0).U.shape[1] == 0


def test_approximation_is_below_A_and_exact_on_its_directions(A):
    rng = np.random.default_rng(62)
    X = rng.standard_normal((10, 3 * NODES))
    recycled = approximated_by(A, [*X, X[0] - 2.0 * X[3], 1e-9 * X[1]], 100)  # repetitions add nothing
    assert recycled.U.shape[1] == 10
    nystrom = recycled.U @ recycled.U.T
    assert np.allclose(nystrom @ X.T, A @ X.T, rtol=1e-8, atol=1e-8)
    assert np.linalg.eigvalsh(A - nystrom).min() >= -1e-10 * np.linalg.norm(A, 2)
    part = recycled.learnt.part
    assert 0.5 <= part <= 1.0
    assert np.allclose(recycled.rest.ravel(), np.maximum(np.diag(A - nystrom), 0.2 * part * np.diag(A)))


def model_of(recycled):
    """The approximation as a matrix, column by column."""
    return np.column_stack([recycled.mult(e.reshape(-1, 3)).ravel() for e in np.eye(3 * NODES)])


def test_what_stands_in_for_A_is_A_on_all_pairs_and_positive_definite(A):
    """And its inverse, with nodal springs, from that of the nodal part: also where the springs are zero."""
    rng = np.random.default_rng(68)
    X = rng.standard_normal((10, 3 * NODES))
    recycled = approximated_by(A, X, 100, exact=True)
    model = model_of(recycled)
    assert np.allclose(model @ X.T, A @ X.T, rtol=1e-8, atol=1e-8)
    assert np.allclose(model, model.T) and np.linalg.eigvalsh(model).min() > 0.0
    fewer = approximated_by(A, X, 6, exact=True)  # without the pairs that are left out
    assert np.allclose(model_of(fewer) @ fewer._X, fewer.U, rtol=1e-8, atol=1e-8)
    frictional = np.arange(NODES) != 3
    kept = np.setdiff1d(np.arange(3 * NODES), [10, 11])
    for springs in (np.zeros((NODES, 3)), 10.0 ** rng.uniform(-6, 6, (NODES, 3))):
        nodal = recycled.rest + springs
        columns = recycled.nodal_columns(3, frictional)
        inverse = LowRankUpdate(MPI.COMM_SELF, lambda r, nodal=nodal: (r.T / nodal.T).T, columns, recycled.signs)
        z = rng.standard_normal((NODES, 3)) / (1.0 + springs)
        z[3, 1:] = 0.0
        r = (model + np.diag(springs.ravel()))[:, kept] @ z.ravel()[kept]
        r[[10, 11]] = 0.0
        assert np.allclose(inverse(r.reshape(-1, 3)), z, rtol=1e-6, atol=1e-9)


def test_a_tenth_of_the_rest_stays_where_products_are_inexact(A):
    """On all pairs the approximation is A + 0.1 D; it is symmetric positive definite."""
    X = np.random.default_rng(69).standard_normal((10, 3 * NODES))
    recycled = approximated_by(A, X, 100, replaced=0.9)
    model = model_of(recycled)
    assert np.allclose(model @ X.T, (A + 0.1 * np.diag(recycled.rest.ravel())) @ X.T, rtol=1e-8, atol=1e-8)
    assert np.allclose(model, model.T) and np.linalg.eigvalsh(model).min() > 0.0


def test_all_of_the_rest_stays_once_errors_of_products_have_shown(A):
    """As after products that do not decrease the gradient: D + U U^T, on these pairs and on those to come."""
    X = np.random.default_rng(70).standard_normal((10, 3 * NODES))
    recycled = approximated_by(A, X[:6], 100, replaced=0.9)
    recycled.replace_nothing()
    for later in ([], X[6:]):
        for x in later:
            recycled.record(x.reshape(-1, 3), (A @ x).reshape(-1, 3))
        recycled.update()
        model = np.diag(recycled.rest.ravel()) + recycled.U @ recycled.U.T
        assert np.allclose(model_of(recycled), model, rtol=1e-12, atol=1e-12) and np.all(recycled.signs == 1.0)


def test_a_rigid_motion_in_the_approximation_leaves_a_small_rest():
    """A body on soft springs: diag(A) is dominated by rigid motion, the rest is a ten-thousandth of it."""
    rng = np.random.default_rng(67)
    whole, elastic = np.ones(3 * NODES), np.diag(rng.uniform(0.5, 1.0, 3 * NODES))
    soft = 1e4 * np.outer(whole, whole) + elastic
    X = np.vstack([whole, rng.standard_normal((6, 3 * NODES))])
    for exact, least in ((True, 1e-5), (False, 0.1)):
        recycled = approximated_by(soft, X[:1], 100, exact)
        for x in X[1:]:  # the error of U is measured on new pairs
            recycled.record(x.reshape(-1, 3), (soft @ x).reshape(-1, 3))
        recycled.update()
        known = recycled.learnt.part
        recycled.record(whole.reshape(-1, 3), (soft @ whole).reshape(-1, 3))  # a pair without a new part says nothing
        recycled.update()
        assert recycled.learnt.part == known
        part = recycled.rest.ravel() / np.diag(soft)
        assert np.all(part >= least * 0.99) and np.all(part <= (1e-3 if exact else 0.11)), part


def test_truncation_keeps_the_largest_and_its_pairs(A):
    values, V = np.linalg.eigh(A)
    recycled = approximated_by(A, V.T[::-1][:15], 6)
    assert np.allclose(np.sort(np.linalg.svd(recycled.U, compute_uv=False) ** 2), values[-6:])
    for x in V.T[:3]:  # small eigenvectors, which must not push out the large ones
        recycled.record(x.reshape(-1, 3), (A @ x).reshape(-1, 3))
    recycled.update()
    assert np.allclose(np.sort(np.linalg.svd(recycled.U, compute_uv=False) ** 2), values[-6:])


def test_pairs_of_very_different_sizes_are_all_kept(A):
    X = np.random.default_rng(69).standard_normal((4, 3 * NODES)) * np.array([[1.0], [1e-7], [1e7], [1.0]])
    model = model_of(approximated_by(A, X, 100, exact=True))
    assert np.allclose(model @ (X / np.abs(X).max(axis=1)[:, None]).T, A @ (X / np.abs(X).max(axis=1)[:, None]).T)


def test_an_approximation_fits_its_own_arguments_only(A):
    recycled, diagonal = approximated_by(A, [], 5), np.diag(A).reshape(-1, 3)
    assert recycled.fits(diagonal.copy(), 5, False)
    other = diagonal.copy()
    other[3, 1] *= 1.5
    assert not (recycled.fits(other, 5, False) or recycled.fits(diagonal, 6, False) or recycled.fits(diagonal, 5, True))


def test_theorem_1_holds_with_the_approximation(A):
    """P^-1 J_AM: positive eigenvalues, 1 with multiplicity 2 m; and P^-1 is the inverse of P."""
    rng = np.random.default_rng(63)
    angle = rng.uniform(0.0, 6.28, NODES)
    y = rng.uniform(0.0, 0.999, NODES)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    frictional = np.ones(NODES, dtype=bool)
    frictional[4], y[4] = False, 0.0
    D22 = 10.0 ** rng.uniform(-6, 6, (NODES, 2))
    h = 10.0 ** rng.uniform(-6, 1, NODES)
    h[4], D22[4, 1] = 0.0, 1.0
    at = Linearization(np.zeros(NODES), np.ones(NODES), h, y, D22, frictional)
    newton = AugmentedSystem().system(ScaledCompliance(dense_compliance(A), np.ones((NODES, 3)), 1.0, 1.0), False)
    r1, r2 = rng.standard_normal((NODES, 3)), np.zeros((NODES, 2))
    r1[4, 1:] = 0.0
    first = newton.solve(NewtonEquations(at, r1, r2, np.ones((NODES, 3)), 1e-8, np.inf))
    again = newton.solve(NewtonEquations(at, r1, r2, np.ones((NODES, 3)), 1e-8, np.inf))
    assert again.iterations < 0.7 * first.iterations  # the same system, with its approximation
    stand_in = model_of(newton._A)
    newton.solve(NewtonEquations(at, r1, r2, np.ones((NODES, 3)), 1e-8, np.inf))  # preconditioned with it
    P, J = augmented_matrix(stand_in, at), augmented_matrix(A, at)
    e = np.eye(5 * NODES)  # node by node in the solver, constraints behind the forces in the matrix
    own = [5 * i + k for i in range(NODES) for k in range(3)] + [5 * i + k for i in range(NODES) for k in (3, 4)]
    for j in set(range(5 * NODES)) - {13, 14}:  # node 4 has no friction
        r = np.zeros(5 * NODES)
        r[own[j]] = 1.0
        z = newton._preconditioner(r.reshape(-1, 5)).ravel()[own]
        assert np.allclose(P @ z, e[j], atol=1e-6)
    values = np.linalg.eigvals(np.linalg.solve(P, J))
    newton.destroy()
    assert np.abs(values.imag).max() <= 1e-5 and values.real.min() > 0.0
    assert np.sum(np.abs(values - 1.0) <= 1e-4) >= 2 * NODES


def test_products_at_most_the_papers():
    for row in measure([12], ["PF(0.3,0.99)", "PF(0.1,0.9)", "PF(0.01,0.99)"]):
        assert row.residual <= 1e-6
        assert row.products <= int(PAPER[row.solver, row.p].split("/")[1]), row
