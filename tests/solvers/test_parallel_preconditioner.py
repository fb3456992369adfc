"""The preconditioner of the semismooth Newton systems: against its matrix, from point to point, and on any number of
ranks: run alone, or with mpirun."""

import dataclasses

import numpy as np
import pytest
from conftest import random_spd
from mpi4py import MPI
from shared_problems import NODES, equations

from coulomb.linalg.compliance.low_rank import LowRankApproximation
from coulomb.linalg.reductions import concatenated
from coulomb.solvers.contact_preconditioner import ContactPreconditioner

COMM = MPI.COMM_WORLD


def problem(columns=12, exact=True, comm=MPI.COMM_SELF, nodes=slice(None)):
    """A, a point, what is learnt from products by A of the nodes of a rank, and a right-hand side."""
    rng = np.random.default_rng(6)
    A, at = random_spd(3 * NODES, 1e3, rng), equations(rng)
    known = LowRankApproximation(comm, np.diag(A).reshape(-1, 3)[nodes], 100, exact=exact)
    for x in rng.standard_normal((columns, 3 * NODES)):
        known.record(x.reshape(-1, 3)[nodes], (A @ x).reshape(-1, 3)[nodes])
    known.update()
    return A, at, known, rng.standard_normal((NODES, 3))


def moved_to(known, at):
    inverse = ContactPreconditioner(MPI.COMM_SELF, known)
    inverse.move(at)
    return inverse


def between(at, changed):
    """A point like another, but for the equations of some nodes."""
    rng, chosen = np.random.default_rng(7), np.isin(np.arange(NODES), list(changed))[:, None, None]
    P = np.where(chosen, at.P + rng.uniform(0.1, 1.0, at.P.shape), at.P)
    return dataclasses.replace(at, P=P, Q=np.where(chosen, 0.8 * at.Q, at.Q))


@pytest.mark.parametrize("columns", [0, 12])
def test_it_is_the_inverse_with_the_approximation_in_place_of_A(columns):
    A, at, known, _ = problem(columns)
    rng = np.random.default_rng(5)
    for _ in range(2):  # once more, after the columns have changed
        for x in rng.standard_normal((columns, 3 * NODES)):
            known.record(x.reshape(-1, 3), (A @ x).reshape(-1, 3))
        known.update()
        M = np.column_stack([known.mult(e.reshape(-1, 3)).ravel() for e in np.eye(3 * NODES)])
        for i in range(NODES):
            rows = slice(3 * i, 3 * i + 3)
            M[rows] = at.Q[i] @ M[rows]
            M[rows, rows] += at.P[i]
        r = rng.standard_normal((NODES, 3, 2))
        inverse = moved_to(known, at)
        expected = np.linalg.solve(M, r.reshape(-1, 2)).reshape(r.shape)
        np.testing.assert_allclose(inverse(r), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
        np.testing.assert_allclose(inverse(r[:, :, 0]), expected[:, :, 0], atol=1e-9 * np.abs(expected).max())


def test_from_point_to_point_it_is_what_it_is_there():
    """Nodes change one after the other, then all; changes below three hundredths are left out."""
    _, at, known, r = problem()
    moving = ContactPreconditioner(MPI.COMM_SELF, known)
    for taken in (0, 1, 3, 3, NODES, 2, 0):
        point = between(at, range(taken))
        moving.move(point)
        np.testing.assert_allclose(moving(r), moved_to(known, point)(r), rtol=1e-9, atol=1e-9 * np.abs(r).max())
    unmoved = moving(r)
    moving.move(dataclasses.replace(at, P=at.P + 0.02))
    np.testing.assert_array_equal(moving(r), unmoved)


def test_where_products_are_not_exact_every_change_counts():
    _, at, known, r = problem(exact=False)
    near, moving = dataclasses.replace(at, P=at.P + 0.02), moved_to(known, at)
    before = moving(r)
    moving.move(near)
    expected = moved_to(known, near)(r)
    np.testing.assert_allclose(moving(r), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    assert np.abs(before - expected).max() > 1e-3 * np.abs(expected).max()


def test_a_node_whose_equations_were_nearly_singular_leaves_no_rounding_errors():
    _, at, known, r = problem()
    P, Q, expected = at.P.copy(), at.Q.copy(), moved_to(known, at)(r)
    Q[0], P[0] = np.eye(3), -(1.0 - 1e-9) * np.diag(known.rest[0])
    moving = ContactPreconditioner(MPI.COMM_SELF, known)
    for point in (at, dataclasses.replace(at, P=P, Q=Q), at):
        moving.move(point)
    np.testing.assert_allclose(moving(r), expected, rtol=1e-11, atol=1e-11 * np.abs(expected).max())


@pytest.mark.ranks
def test_ranks_apply_what_one_rank_does():
    """At one point and at others, of which some change nodes of one rank only; the last of several has none."""
    mine = np.arange(NODES) * max(COMM.size - 1, 1) // NODES == COMM.rank
    _, at, known, r = problem()
    here, whole = ContactPreconditioner(COMM, problem(comm=COMM, nodes=mine)[2]), moved_to(known, at)
    for changed in ([], [0], [NODES - 1], range(NODES), [1, 2]):
        point = between(at, changed)
        whole.move(point)
        here.move(dataclasses.replace(point, P=point.P[mine], Q=point.Q[mine]))
        expected, found = whole(r), concatenated(COMM, here(r[mine]))
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())
