"""A body on soft springs by multigrid, on any number of ranks."""

import numpy as np
import pytest
from mpi4py import MPI
from test_soft_motions import two_bodies

from coulomb import IterativeSolver
from coulomb.linalg.reductions import Reductions


def test_a_body_on_soft_springs():
    """As many products as on one rank, and springs and contact carry the load of 3.2 MN."""
    solution = two_bodies(linear_solver=IterativeSolver).solve()
    assert solution.certificate.passed and solution.result.products <= 300
    over, x = Reductions(MPI.COMM_WORLD), solution.contact_force.reshape(-1, 3)
    spring = solution.problem.elasticity.spring * solution.displacement
    assert over.sum(x[:, 0]) - over.sum(spring[:, 2]) == pytest.approx(3.2e6, rel=1e-9)
    assert np.all(x[:, 0] >= 0.0)
