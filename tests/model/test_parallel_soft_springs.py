"""A body on soft springs by multigrid, on any number of ranks."""

import numpy as np
import pytest
from mpi4py import MPI
from test_soft_motions import STEEL, two_bodies

import coulomb
from coulomb import Elasticity, IterativeSolver, Spring
from coulomb.linalg.reductions import Reductions


def test_a_body_on_soft_springs():
    """As many products as on one rank, and springs and contact carry the load of 3.2 MN."""
    solution = two_bodies(linear_solver=IterativeSolver).solve()
    assert solution.certificate.passed and solution.result.products <= 300
    over, x = Reductions(MPI.COMM_WORLD), solution.contact_force.reshape(-1, 3)
    spring = -solution.problem.elasticity.spring_force(solution.displacement)
    assert over.sum(x[:, 0]) - over.sum(spring[:, 2]) == pytest.approx(3.2e6, rel=1e-9)
    assert np.all(x[:, 0] >= 0.0)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_springs_are_integrated_and_are_those_of_the_stiffness(cell, degree):
    """The energy of a tilted face is stiffness times its inertia; K u is internal forces less those of the springs."""
    mesh = coulomb.box((1.0, 2.0, 0.5), (3, 4, 2), cell, degree=degree)
    body = Elasticity(mesh, STEEL, [], springs=[Spring("bottom", (0.0, 0.0, 3e9)), Spring("left", 1e9)])
    over = Reductions(MPI.COMM_WORLD)
    tilted = np.zeros_like(body.x)
    tilted[:, 2] = body.x[:, 0]
    bottom, left = body.spring_forces(tilted)
    assert over.sum(-bottom.forces * tilted) == pytest.approx(3e9 * 2.0 / 3.0, rel=1e-12)
    assert over.max(np.abs(left.forces)) <= 1e-12 * over.max(np.abs(bottom.forces))
    u = np.sin(body.x @ [[7.0, 3.0, 5.0], [2.0, 9.0, 4.0], [6.0, 1.0, 8.0]])
    given, product = body.K.createVecs()
    given.array[:] = u.ravel()
    body.K.mult(given, product)
    off = product.array.reshape(-1, 3) - body.internal_force(u) + body.spring_force(u) - body.anchoring * u
    assert over.max(np.abs(off)) <= 1e-12 * over.max(np.abs(product.array))
