"""The preconditioner of the semismooth Newton systems on any number of ranks: run alone, or with mpirun."""

import dataclasses

import numpy as np
from conftest import random_spd
from mpi4py import MPI
from shared_problems import NODES, equations

from coulomb.linalg.compliance.low_rank import LowRankApproximation
from coulomb.linalg.reductions import concatenated
from coulomb.solvers.semismooth_newton import ContactPreconditioner

COMM = MPI.COMM_WORLD


def approximation(comm, A, nodes):
    """Learnt from products by A of the nodes of a rank; the last rank may have none."""
    rng, known = np.random.default_rng(7), LowRankApproximation(comm, np.diag(A).reshape(-1, 3)[nodes], 100, exact=True)
    for x in rng.standard_normal((12, 3 * NODES)):
        known.record(x.reshape(-1, 3)[nodes], (A @ x).reshape(-1, 3)[nodes])
    known.update()
    return known


def test_ranks_apply_what_one_rank_does():
    """At one point and at others, of which some change nodes of one rank only."""
    rng = np.random.default_rng(6)
    A, at = random_spd(3 * NODES, 1e3, rng), equations(rng)
    other = dataclasses.replace(at, P=at.P + rng.uniform(0.1, 1.0, at.P.shape), Q=0.8 * at.Q)
    r = rng.standard_normal((NODES, 3))
    mine = np.arange(NODES) * max(COMM.size - 1, 1) // NODES == COMM.rank
    here = ContactPreconditioner(COMM, approximation(COMM, A, mine))
    whole = ContactPreconditioner(MPI.COMM_SELF, approximation(MPI.COMM_SELF, A, np.full(NODES, True)))
    for changed in ([], [0], [NODES - 1], range(NODES), [1, 2]):
        chosen = np.isin(np.arange(NODES), list(changed))[:, None, None]
        P, Q = np.where(chosen, other.P, at.P), np.where(chosen, other.Q, at.Q)
        whole.move(dataclasses.replace(at, P=P, Q=Q))
        here.move(dataclasses.replace(at, P=P[mine], Q=Q[mine]))
        expected, found = whole(r), concatenated(COMM, here(r[mine]))
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())
