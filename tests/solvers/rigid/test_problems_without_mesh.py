"""Contact problems without a mesh."""

import numpy as np
import pytest
import scipy.sparse
from conftest import random_spd
from petsc4py import PETSc

from coulomb import solve_coulomb, solve_tresca
from coulomb.solvers import KPRGP


def test_one_contact_by_hand():
    assert np.allclose(solve_tresca(np.eye(3), [2.0, 3.0, 4.0], 1.0).x, [2.0, 0.6, 0.8], atol=1e-7)
    assert np.allclose(solve_tresca(np.eye(3), [2.0, 3.0, 4.0], [1.0], lower=2.5).x, [2.5, 0.6, 0.8], atol=1e-7)
    assert np.allclose(solve_coulomb(np.eye(3), [2.0, 3.0, 4.0], 0.5).x, [2.0, 0.6, 0.8], atol=1e-7)


def test_numpy_scipy_and_petsc_alike():
    rng = np.random.default_rng(81)
    A = random_spd(30, 100.0, rng)
    b, g = rng.standard_normal(30), rng.uniform(0.1, 1.0, 10)
    petsc = PETSc.Mat().createDense(A.shape, array=np.asfortranarray(A), comm=PETSc.COMM_SELF)
    petsc.assemble()
    answers = [solve_tresca(kind, b, g).x for kind in (A, A.tolist(), scipy.sparse.csr_matrix(A), petsc)]
    for x in answers[1:]:
        assert np.allclose(x, answers[0], atol=1e-10)
    assert np.allclose(solve_tresca(A, b, g, solver=KPRGP()).x, answers[0], atol=1e-6)
    assert np.allclose(solve_coulomb(scipy.sparse.csc_matrix(A), b, 0.3).x, solve_coulomb(A, b, np.full(10, 0.3)).x)


@pytest.mark.parametrize(
    ("A", "b", "g", "message"),
    [
        (np.eye(4), np.zeros(4), 1.0, r"A must be square with three rows per contact, but has shape \(4, 4\)"),
        (np.ones((3, 6)), np.zeros(3), 1.0, r"A must be square .* shape \(3, 6\)"),
        (np.array([[1, 2, 0], [0, 1, 0], [0, 0, 1.0]]), np.zeros(3), 1.0, "A must be symmetric"),
        (-np.eye(3), np.zeros(3), 1.0, "A must be positive semidefinite"),
        (np.full((3, 3), np.nan), np.zeros(3), 1.0, "A has entries that are not finite"),
        (np.eye(3), np.zeros(6), 1.0, r"b must have shape \(3,\)"),
        (np.eye(3), [0.0, np.nan, 0.0], 1.0, "b has entries that are not finite"),
        (np.eye(3), np.zeros(3), [1.0, 1.0], r"slip_bound must have shape \(1,\)"),
        (np.eye(3), np.zeros(3), -1.0, "slip_bound has negative entries"),
        ("stiff", np.zeros(3), 1.0, "A must be made of numbers"),
    ],
)
def test_bad_input(A, b, g, message):
    with pytest.raises(ValueError, match=message):
        solve_tresca(A, b, g)
