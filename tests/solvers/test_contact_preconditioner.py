"""The preconditioner of the semismooth Newton method against its matrix; which approximation later steps keep."""

import dataclasses

import numpy as np
import pytest
from conftest import random_spd
from mpi4py import MPI
from shared_problems import NODES, equations

from coulomb.linalg.compliance.low_rank import LowRankApproximation
from coulomb.solvers.semismooth_newton import ContactPreconditioner


@pytest.mark.parametrize("columns", [0, 12])
def test_it_is_the_inverse_with_the_approximation_in_place_of_A(columns):
    rng = np.random.default_rng(5)
    A, at = random_spd(3 * NODES, 1e3, rng), equations(rng)
    known = LowRankApproximation(MPI.COMM_SELF, np.diag(A).reshape(-1, 3).copy(), 100, exact=True)
    for _ in range(2):  # once more, after the columns have changed
        for x in rng.standard_normal((columns, 3 * NODES)):
            known.record(x.reshape(-1, 3), (A @ x).reshape(-1, 3))
        known.update()
        model = np.column_stack([known.mult(e.reshape(-1, 3)).ravel() for e in np.eye(3 * NODES)])
        M = np.zeros((3 * NODES, 3 * NODES))
        for i in range(NODES):
            rows = slice(3 * i, 3 * i + 3)
            M[rows] = at.Q[i] @ model[rows]
            M[rows, rows] += at.P[i]
        r = rng.standard_normal((NODES, 3, 2))
        inverse = ContactPreconditioner(MPI.COMM_SELF, known)
        inverse.move(at)
        expected = np.linalg.solve(M, r.reshape(-1, 2)).reshape(r.shape)
        np.testing.assert_allclose(inverse(r), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
        np.testing.assert_allclose(inverse(r[:, :, 0]), expected[:, :, 0], atol=1e-9 * np.abs(expected).max())


def test_from_point_to_point_it_is_what_it_is_there():
    """Nodes change one after the other, then all; changes below three hundredths are left out."""
    rng = np.random.default_rng(6)
    A, at = random_spd(3 * NODES, 1e3, rng), equations(rng)
    other = dataclasses.replace(at, P=at.P + rng.uniform(0.1, 1.0, at.P.shape), Q=0.8 * at.Q)
    known = LowRankApproximation(MPI.COMM_SELF, np.diag(A).reshape(-1, 3).copy(), 100, exact=True)
    for x in rng.standard_normal((12, 3 * NODES)):
        known.record(x.reshape(-1, 3), (A @ x).reshape(-1, 3))
    known.update()
    moving, r = ContactPreconditioner(MPI.COMM_SELF, known), rng.standard_normal((NODES, 3))
    for taken in (0, 1, 3, 3, NODES, 2, 0):
        here = np.arange(NODES) < taken
        P, Q = (np.where(here[:, None, None], there, before) for there, before in ((other.P, at.P), (other.Q, at.Q)))
        point = dataclasses.replace(at, P=P, Q=Q)
        moving.move(point)
        fresh = ContactPreconditioner(MPI.COMM_SELF, known)
        fresh.move(point)
        np.testing.assert_allclose(moving(r), fresh(r), rtol=1e-9, atol=1e-9 * np.abs(r).max())
    unmoved = moving(r)
    moving.move(dataclasses.replace(at, P=at.P + 0.02))
    np.testing.assert_array_equal(moving(r), unmoved)


def test_where_products_are_not_exact_every_change_counts():
    rng = np.random.default_rng(6)
    A, at = random_spd(3 * NODES, 1e3, rng), equations(rng)
    known = LowRankApproximation(MPI.COMM_SELF, np.diag(A).reshape(-1, 3).copy(), 100, exact=False)
    for x in rng.standard_normal((12, 3 * NODES)):
        known.record(x.reshape(-1, 3), (A @ x).reshape(-1, 3))
    known.update()
    near, r = dataclasses.replace(at, P=at.P + 0.02), rng.standard_normal((NODES, 3))
    moving, fresh = (ContactPreconditioner(MPI.COMM_SELF, known) for _ in range(2))
    moving.move(at)
    before = moving(r)
    moving.move(near)
    fresh.move(near)
    expected = fresh(r)
    np.testing.assert_allclose(moving(r), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    assert np.abs(before - expected).max() > 1e-3 * np.abs(expected).max()


def test_a_node_whose_equations_were_nearly_singular_leaves_no_rounding_errors():
    rng = np.random.default_rng(6)
    A, at = random_spd(3 * NODES, 1e3, rng), equations(rng)
    known = LowRankApproximation(MPI.COMM_SELF, np.diag(A).reshape(-1, 3).copy(), 100, exact=True)
    for x in rng.standard_normal((12, 3 * NODES)):
        known.record(x.reshape(-1, 3), (A @ x).reshape(-1, 3))
    known.update()
    P, Q, r = at.P.copy(), at.Q.copy(), rng.standard_normal((NODES, 3))
    Q[0], P[0] = np.eye(3), -(1.0 - 1e-9) * np.diag(known.rest[0])
    moving, fresh = (ContactPreconditioner(MPI.COMM_SELF, known) for _ in range(2))
    for point in (at, dataclasses.replace(at, P=P, Q=Q), at):
        moving.move(point)
    fresh.move(at)
    expected = fresh(r)
    np.testing.assert_allclose(moving(r), expected, rtol=1e-11, atol=1e-11 * np.abs(expected).max())


def test_an_approximation_is_taken_again_only_for_the_same_A():
    d = np.arange(1.0, 7.0).reshape(2, 3)
    known = LowRankApproximation(MPI.COMM_SELF, d, 60, exact=True)
    assert known.fits(d.copy(), 60, True)
    assert not known.fits(2.0 * d, 60, True) and not known.fits(d, 61, True) and not known.fits(d, 60, False)
