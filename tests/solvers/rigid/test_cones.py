"""Second-order cones, and sums of a matrix and nodal blocks: against their definitions."""

import numpy as np
import pytest
import scipy.sparse

from coulomb.solvers.rigid import newton_matrix
from coulomb.solvers.rigid.cones import (
    determinant,
    product,
    project,
    project_on_friction_cones,
    quotient,
    radius,
    scaling,
    step_to_boundary,
    times,
)
from coulomb.solvers.rigid.newton_matrix import NewtonMatrix

RNG = np.random.default_rng(141)


def inside(m=50):
    t = RNG.standard_normal((m, 2))
    return np.column_stack([np.linalg.norm(t, axis=1) * (1.0 + 10.0 ** RNG.uniform(-6, 2, m)), t])


def test_product_and_quotient():
    x, y = inside(), RNG.standard_normal((50, 3))
    assert np.allclose(product(x, quotient(x, y)), y, atol=1e-6)
    assert np.allclose(product(np.tile([1.0, 0.0, 0.0], (50, 1)), y), y)
    assert np.allclose(product(x, y)[:, 0], np.einsum("ij,ij->i", x, y))


def test_without_friction_only_pressing_forces_stay():
    r = np.array([[-1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [-1.0, 3.0, 0.0], [2.0, 3.0, 0.0]])
    assert np.array_equal(project_on_friction_cones(r, np.zeros(4)), np.maximum(r, 0.0) * [1.0, 0.0, 0.0])


def test_scaling_maps_both_to_one_point_and_the_cone_to_itself():
    x, z, y = inside(), inside(), inside()
    P = scaling(x, z)
    size = np.linalg.norm(P.point, axis=1)[:, None]
    assert np.allclose(times(P.inverse, z) / size, P.point / size, atol=1e-6)
    assert np.allclose(times(P.square, x), z, rtol=1e-4, atol=1e-6)
    assert np.allclose(P.P @ P.inverse, np.eye(3), atol=1e-6)
    assert np.all(determinant(times(P.P, y)) > 0.0)


def test_step_to_boundary_is_where_the_first_determinant_vanishes():
    x, dx = inside(), RNG.standard_normal((50, 3))
    t = step_to_boundary(x, dx)
    assert np.all(determinant(x + 0.999999 * t * dx) > 0.0)
    beyond = x + 1.0001 * t * dx
    assert np.any((determinant(beyond) < 0.0) | (beyond[:, 0] < 0.0))
    assert step_to_boundary(x, inside()) == np.inf
    assert step_to_boundary(x, -0.5 * x) == pytest.approx(2.0, rel=1e-4)  # a double root: half the digits


def test_projection_is_the_nearest_point_and_its_derivative_that_of_differences():
    y = RNG.standard_normal((200, 3))
    P = project(y)
    assert np.all(P.point[:, 0] >= radius(P.point) - 1e-12)
    away = P.point - y  # Moreau: away is in the cone too, and orthogonal to the projection
    assert np.all(away[:, 0] >= radius(away) - 1e-12)
    assert np.allclose(np.einsum("ij,ij->i", away, P.point), 0.0, atol=1e-12)
    dy, h = RNG.standard_normal((200, 3)), 1e-6
    difference = (project(y + h * dy).point - project(y - h * dy).point) / (2.0 * h)
    kink = np.minimum(np.abs(P.lower), np.abs(P.upper)) < 1e-4
    assert np.allclose(times(P.derivative(), dy)[~kink], difference[~kink], atol=1e-5)


def test_projection_on_friction_cones():
    """With F = 1 it is the projection on the second-order cone; with F = 0 friction vanishes."""
    y = RNG.standard_normal((100, 3))
    assert np.allclose(project_on_friction_cones(y, np.ones(100)), project(y).point)
    frictionless = project_on_friction_cones(y, np.zeros(100))
    assert np.allclose(frictionless[:, 0], np.maximum(y[:, 0], 0.0)) and not frictionless[:, 1:].any()


@pytest.mark.parametrize("density", [1.0, 0.02], ids=["dense", "sparse"])
def test_newton_matrix(density):
    m = 60
    G = scipy.sparse.random(3 * m, 3 * m, density / 3.0, random_state=1, format="csr")
    W = (G @ G.T).tocsr()
    matrix = NewtonMatrix(W)
    assert matrix.dense == (density == 1.0)
    D = RNG.standard_normal((m, 3, 3)) * 10.0 ** RNG.uniform(-4, 4, m)[:, None, None]
    L = RNG.standard_normal((m, 3, 3))
    right = RNG.standard_normal((m, 3))
    for rows in (None, L):
        whole = scipy.sparse.block_diag(D).toarray()
        whole += W.toarray() if rows is None else scipy.sparse.block_diag(rows) @ W.toarray()
        assert matrix.factorise(D, rows)
        x = matrix.solve(right)
        assert np.linalg.norm(whole @ x.ravel() - right.ravel()) <= 1e-9 * np.linalg.norm(right)
    assert matrix.factorisations == 2 and matrix.operations > 0.0
    singular = np.zeros((m, 3, 3))
    assert not matrix.factorise(singular, singular)
    assert not matrix.factorise(np.full((m, 3, 3), np.nan))


def test_operations_of_sparse_factors():
    """One contact touches all others, which are eliminated first: a column with k entries below the diagonal, 5, 4, 3
    of each, 2, 1 and 0 of the last, takes 2 k (k + 1); also if the first matrix had none but its diagonal blocks."""
    m = 60
    touches = np.eye(m)
    touches[0] = touches[:, 0] = 1.0
    W = np.kron(touches, np.ones((3, 3))) * RNG.uniform(0.5, 1.0, (3 * m, 3 * m))
    matrix, D = NewtonMatrix(scipy.sparse.csr_matrix(W + W.T)), 10.0 * np.eye(3) + RNG.uniform(0.5, 1.0, (m, 3, 3))
    D[0] += 1000.0 * np.eye(3)
    assert matrix.factorise(D, np.zeros((m, 3, 3))) and not matrix.dense
    for rows in (None, D):
        before = matrix.operations
        assert matrix.factorise(D, rows)
        assert matrix.operations - before == pytest.approx(124.0 * (m - 1) + 16.0 + newton_matrix._OVERHEAD * m, abs=1)
    matrix.limit = matrix.operations - 1.0
    assert not matrix.factorise(D) and matrix.factorisations == 3


def test_columns_of_blocks():
    """In both orders; a contact whose block of W is zero has one of D all the same."""
    m = 60
    G = scipy.sparse.random(3 * m, 3 * m, 0.007, random_state=2, format="lil")
    G[30:33] = 0.0
    W = (G @ G.T).tocsr()
    D, L, right = RNG.standard_normal((m, 3, 3)), RNG.standard_normal((m, 3, 3)), RNG.standard_normal((m, 3))
    matrix = NewtonMatrix(W)
    assert not matrix.dense
    for rows in (None, L, None):
        assert matrix.factorise(D, rows)
        pattern = matrix._pattern
        data, r, c = pattern.entries(D, rows)
        x = matrix.solve(right)
        whole = scipy.sparse.block_diag(D) + (W if rows is None else scipy.sparse.block_diag(rows) @ W)
        assert np.linalg.norm(whole @ x.ravel() - right.ravel()) <= 1e-9 * np.linalg.norm(right)
        scaled = (scipy.sparse.diags(r) @ whole @ scipy.sparse.diags(c)).toarray()
        order = np.arange(3 * m) if pattern.order is None else pattern.order
        stored = scipy.sparse.csc_matrix((data, pattern.indices, pattern.indptr), shape=W.shape).toarray()
        assert np.allclose(stored, scaled[np.ix_(order, order)], rtol=1e-10, atol=1e-12)
        assert np.allclose(np.abs(scaled).max(axis=0), 1.0)
