"""Parts of a problem work after the rest is deleted: communicators end with DOLFINx's meshes."""

import gc

import numpy as np
import pytest
from conftest import make_block

from coulomb import InteriorPoint
from coulomb.solvers import DirectSolver, IterativeSolver


def test_matrices_outlive_their_mesh():
    K, B = (make_block(2).elasticity.K, make_block(2).surface.B)
    gc.collect()
    for matrix in (K, B):
        x, y = matrix.createVecs()
        x.set(1.0)
        matrix.mult(x, y)
        assert np.isfinite(y.norm())


@pytest.mark.parametrize(
    "options", [{}, {"explicit": False, "linear_solver": DirectSolver}, {"linear_solver": IterativeSolver}]
)
def test_a_tresca_problem_outlives_its_body(options):
    problem = make_block(2, slip_stress=1e7, **options)
    qp = problem.friction_problem
    expected = problem.solve().contact_force
    del problem
    gc.collect()
    x = InteriorPoint(tolerance=1e-8).solve(qp).x
    assert np.linalg.norm(x - expected) <= 1e-6 * np.linalg.norm(expected)
