"""Rigid motions on soft springs, computed apart: which they are, products by A, what is learnt of A, and the path."""

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from shared_problems import two_bodies
from user_forms import Script

import coulomb
from coulomb import Clamp, Elasticity, Material, Spring
from coulomb.linalg.compliance.low_rank import LowRankApproximation
from coulomb.model.conditioning import soft_motions
from coulomb.solvers import IterativeSolver

STEEL = Material(2.1e11, 0.3)


def block(stiffness, clamps=()):
    """A block of steel on the springs of its right side."""
    return Elasticity(coulomb.box((3.0, 1.0, 1.0), (6, 2, 2)), STEEL, clamps, springs=[Spring("right", stiffness)])


def robin():
    """The same of the user's forms."""
    script = Script(coulomb.box((3.0, 1.0, 1.0), (6, 2, 2)), 1)
    springs = sum(1e6 * script.u[i] * script.v[i] for i in range(3)) * script.ds("right")
    return coulomb.Body(script.elasticity(2.1e11, 0.3) + springs, None, faces=script.mesh)


@pytest.mark.parametrize(
    ("body", "count", "ratio"),
    [
        (lambda: block(1e6), 6, 1.0),
        (lambda: block(1e6, [Clamp("left", "y")]), 4, 1.0),
        (lambda: block((1e14, 1e6, 1e6)), 3, 1e8),
        (lambda: block((0.0, 1e6, 1e6), [Clamp("left", "x")]), 3, 1.0),
        (lambda: two_bodies().elasticity, 6, 1.0),
        (robin, 6, 1.0),
    ],
    ids=["all", "beside a plane", "stiff along x", "guided along x", "one body of two", "Robin terms"],
)
def test_motions(body, count, ratio):
    """R^T K R = 1 with the K of the solvers; P^T leaves nothing of K R, and P nothing of R.

    R comes from an eigenvalue problem with the stiffnesses of all springs: the soft motions are as accurate as rounding
    errors of the stiffest allow, `ratio` times the softest.
    """
    given = body()
    soft, K = soft_motions(given), given.K
    R, KR = soft.motions, np.empty_like(soft.motions)
    image, column = K.createVecs()
    for k in range(R.shape[1]):
        column.array[:] = R[:, k]
        K.mult(column, image)
        KR[:, k] = image.array
    assert R.shape[1] == count
    assert np.abs(R.T @ KR - np.eye(count)).max() < 1e-6
    for k in range(count):
        left = KR[:, k].copy()
        assert soft.take_from_forces(left) == pytest.approx(np.eye(count)[k], abs=1e-6)
        assert np.abs(left).max() < 1e-5 * np.abs(KR[:, k]).max()
    moved = R @ np.arange(1.0, 1.0 + count)
    soft.take_from(moved)
    assert np.abs(moved).max() < (1e-10 + 10 * np.finfo(float).eps * ratio) * np.abs(R).max()


@pytest.mark.parametrize(
    ("stiffness", "clamps"), [(1e6, [Clamp("left")]), (1e14, [])], ids=["clamped", "stiff springs"]
)
def test_bodies_without(stiffness, clamps):
    assert soft_motions(block(stiffness, clamps)) is None


def test_products_show_the_elastic_part():
    """To the accuracy asked for, where F F^T is a million times as large; its diagonal is estimated as well."""
    problem = two_bodies(linear_solver=IterativeSolver)
    A, n = problem.A, len(problem.b)
    F = A.rigid
    x = np.random.default_rng(5).standard_normal(n)
    rough, exact = np.empty((2, n))
    A.mult(x, exact, 1e-11)
    A.mult(x, rough, 0.03)
    elastic = exact - F @ (F.T @ x)
    assert np.linalg.norm(exact) > 1e4 * np.linalg.norm(elastic)
    assert np.linalg.norm(rough - exact) < 0.1 * np.linalg.norm(elastic)
    direct = two_bodies(linear_solver=coulomb.solvers.DirectSolver, explicit=False).A
    known = np.empty(n)
    direct.mult(x, known)
    assert np.linalg.norm(exact - known) < 1e-2 * np.linalg.norm(elastic)  # rounding errors of the factors
    rest = A.diagonal() - np.sum(F**2, axis=1)
    column = np.empty(n)
    for row in (0, n // 2 + 1):
        A.mult(np.eye(n)[row], column, 1e-8)
        assert 0.2 < rest[row] / (column - F @ F[row])[row] < 5.0


def test_the_rest_is_learnt_beside_what_is_known():
    """A = A_e + F F^T: exact on all x of which products are known and for F F^T, with the diagonal of A_e elsewhere."""
    rng, m = np.random.default_rng(6), 12
    Q, F = rng.standard_normal((3 * m, 3 * m)), 1e4 * rng.standard_normal((3 * m, 2))
    A_e = Q @ Q.T + np.eye(3 * m)
    A = A_e + F @ F.T
    model = LowRankApproximation(MPI.COMM_SELF, np.diag(A).reshape(-1, 3).copy(), 10, exact=True, rigid=F)
    fresh = (A - F @ F.T).diagonal().reshape(-1, 3)
    z = rng.standard_normal((m, 3))
    known = F @ (F.T @ z.ravel())
    assert np.allclose(model.mult(z).ravel(), known + (fresh * z).ravel(), rtol=1e-9)
    X = rng.standard_normal((3 * m, 4))
    for x in X.T:
        model.record(x.reshape(-1, 3), (A @ x).reshape(-1, 3))
    model.update()
    for x in X.T:
        assert np.allclose(model.mult(x.reshape(-1, 3)).ravel(), A @ x, rtol=1e-6, atol=1e-6 * np.abs(A_e @ x).max())
    assert np.all(model.rest <= 1.01 * fresh) and model.columns.shape[1] == 4 + 4 + 2
    assert model.fits(np.diag(A).reshape(-1, 3), 10, True)


@pytest.mark.parametrize("stiffness", [1e6, 1e8])
def test_path_following(stiffness):
    """With products by A as a whole it takes 12 686 and stagnates, and 1 650 with the stiffer springs."""
    solution = two_bodies(stiffness, linear_solver=IterativeSolver).solve()
    assert solution.certificate.passed and solution.result.products <= 300
    x = solution.contact_force.reshape(-1, 3)
    spring = -solution.problem.elasticity.spring_force(solution.displacement)
    assert x[:, 0].sum() - spring[:, 2].sum() == pytest.approx(3.2e6, rel=1e-9)


def test_in_other_frames():
    """A in axes that have changed places has its motions and its diagonals turned as well."""
    A = two_bodies(linear_solver=IterativeSolver).A
    turn = np.tile([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]], (A.nodes, 1, 1))
    T = PETSc.Mat().createAIJ((3 * A.nodes, 3 * A.nodes), nnz=1)
    for row, column, sign in ((0, 1, 1.0), (1, 2, -1.0), (2, 0, 1.0)):
        for node in range(A.nodes):
            T.setValue(3 * node + row, 3 * node + column, sign)
    T.assemble()
    turned = A.rotated(T.matMult(A.B), turn)
    assert np.allclose(turned.rigid.reshape(A.nodes, 3, -1), turn @ A.rigid.reshape(A.nodes, 3, -1), rtol=1e-12)
    for now, then in ((turned.diagonal(), A.diagonal()), (turned.rest_of_diagonal, A.rest_of_diagonal)):
        assert np.allclose(now.reshape(-1, 3), then.reshape(-1, 3)[:, [1, 2, 0]], rtol=1e-9, atol=0.0)
