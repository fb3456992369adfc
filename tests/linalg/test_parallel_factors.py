"""Factors on the first rank, for all: run alone, or as `mpirun -n 3 python -m pytest ...`."""

import math

import numpy as np
import pytest
from conftest import make_block, to_csr
from mpi4py import MPI
from petsc4py import PETSc
from ranks import everywhere, same_error

from benchmarks.block import block
from coulomb import Clamp, Contact, ContactProblem, Material, Traction, box, join, moved
from coulomb.linalg.compliance import predicted_cost as methods
from coulomb.linalg.compliance.schur_compliance import SchurCompliance
from coulomb.linalg.factors import FirstRankSolver
from coulomb.model import contact_stiffness
from coulomb.solvers import DirectSolver, IterativeSolver

comm = MPI.COMM_WORLD


def dense(matrix):
    """All rows of a distributed matrix, on every rank."""
    return np.concatenate(comm.allgather(to_csr(matrix).toarray()))


def two_bodies():
    """Bodies of different size, with held nodes that are coupled with none, and a rank without nodes of the second."""
    lower = box((1.0, 1.0, 0.5), (5, 4, 3))
    upper = moved(box((0.8, 0.8, 0.4), (4, 3, 2), "tetrahedron"), (0.1, 0.1, 0.5))
    contact = Contact("upper:bottom", against="lower:top", friction=0.3)
    supports = [Clamp("lower:bottom"), Clamp("upper:top")]
    return ContactProblem(join(lower=lower, upper=upper), Material(2e11, 0.3), supports, contact)


@pytest.mark.parametrize("make", [lambda: make_block(3), lambda: block(2, cell="tetrahedron"), two_bodies])
@pytest.mark.parametrize("single", [False, True])
def test_against_dense_algebra(make, single):
    """Products with K^-1 to rounding in both precisions; of A by the factors as accurate as these are."""
    problem = make()
    K, B = problem.elasticity.K, problem.surface.free_B
    solver = FirstRankSolver(K, problem.elasticity.x, problem.surface.nodes_in_rows, single)
    assert set(solver.last) == set(everywhere(problem.surface.nodes_in_rows))
    inverse = np.linalg.inv(dense(K))
    rhs, u = K.createVecs()
    rhs.array[:] = np.random.default_rng([4, comm.rank]).standard_normal(rhs.getLocalSize())
    solver.solve(rhs, u)
    expected = inverse @ everywhere(rhs.array)
    assert np.linalg.norm(everywhere(u.array) - expected) <= 1e-10 * np.linalg.norm(expected)
    in_any_order = FirstRankSolver(K, problem.elasticity.x, np.empty(0, dtype=np.int64), single)
    in_any_order.solve(rhs, u)
    assert np.linalg.norm(everywhere(u.array) - expected) <= 1e-10 * np.linalg.norm(expected)
    tiny = rhs * 1e-60  # single precision has a smaller range
    solver.solve(tiny, u)
    assert np.linalg.norm(1e60 * everywhere(u.array) - expected) <= 1e-10 * np.linalg.norm(expected)
    rows = dense(B)
    whole, A = rows @ inverse @ rows.T, SchurCompliance(B, solver)
    assert np.allclose(everywhere(A.diagonal()), np.diag(whole), rtol=1e-3 if single else 1e-9, atol=0.0)
    x = np.random.default_rng([5, comm.rank]).standard_normal(3 * A.nodes)
    y = np.empty_like(x)
    for tolerance, accuracy in ((0.0, 1e-10), (1e-2, 1e-3 if single else 1e-10)):
        A.mult(x, y, tolerance)
        assert np.linalg.norm(everywhere(y) - whole @ everywhere(x)) <= accuracy * np.linalg.norm(whole @ everywhere(x))
    assert solver.single == single


@pytest.mark.parametrize("single", [False, True])
def test_without_nodes_to_eliminate_last(single):
    """As of a body that nothing touches: its last front is empty."""
    K = two_bodies().elasticity.K
    points = np.random.default_rng([6, comm.rank]).random((K.getLocalSize()[0] // 3, 3))  # they determine the work only
    solver = FirstRankSolver(K, points, np.empty(0, np.int64), single)
    rhs, u = K.createVecs()
    rhs.array[:] = np.random.default_rng([4, comm.rank]).standard_normal(rhs.getLocalSize())
    solver.solve(rhs, u)
    expected = np.linalg.solve(dense(K), everywhere(rhs.array))
    assert np.linalg.norm(everywhere(u.array) - expected) <= 1e-10 * np.linalg.norm(expected)


@pytest.mark.parametrize("where", ["part", "contact"])
def test_a_matrix_that_is_not_positive_definite(where):
    """The failure of one rank is an error on all."""
    problem = make_block(2)
    K = problem.elasticity.K.copy()
    nodes = problem.surface.nodes_in_rows if where == "contact" else np.flatnonzero(problem.elasticity.x[:, 2] > 0.9)
    diagonal = K.getDiagonal()
    largest = diagonal.max()[1]
    rows = 3 * nodes + (0 if where == "contact" else K.getOwnershipRange()[0])
    diagonal.setValues(rows.astype(PETSc.IntType), np.full(len(rows), -largest))
    diagonal.assemble()
    K.setDiagonal(diagonal)
    text = same_error(lambda: FirstRankSolver(K, problem.elasticity.x, problem.surface.nodes_in_rows))
    assert "not positive definite" in text


def test_the_default_of_a_small_body_on_several_ranks():
    """With the forces of one rank to 1e-8."""

    def cube(comm):
        mesh, pull = box((1.0, 1.0, 1.0), (5, 4, 3), comm=comm), Traction("top", (1e7, 2e7, -4e7))
        return ContactProblem(mesh, Material(2e11, 0.3), [Clamp("left")], Contact("bottom", 0.3), [pull])

    alone, together = cube(MPI.COMM_SELF).solve(1e-10), cube(comm).solve(1e-10)
    assert ("first rank" in together.problem.body.stiffness.method) == (comm.size > 1)
    order = np.lexsort(everywhere(together.problem.surface.x).round(9).T)
    forces = everywhere(together.force_on_body)[order]
    expected = alone.force_on_body[np.lexsort(alone.problem.surface.x.round(9).T)]
    assert np.linalg.norm(forces - expected) <= 1e-8 * np.linalg.norm(expected)
    assert together.certificate.passed


@pytest.mark.parametrize("direct", [True, False])
def test_the_ranks_choose_together(monkeypatch, direct):
    """All as the first one."""
    monkeypatch.setattr(methods, "_SMALL", (0, 0))
    monkeypatch.setattr(contact_stiffness, "worth", lambda *_: 0.0 if direct == (comm.rank == 0) else 1e3)
    body = make_block(3).body
    assert body.stiffness.explicit is direct and body.stiffness.linear_solver is (
        DirectSolver if direct else IterativeSolver
    )
    monkeypatch.undo()
    monkeypatch.setattr(methods, "_SMALL", (0, 0))
    monkeypatch.setattr(contact_stiffness, "worth", lambda *_: 0.0)  # else on 4 ranks multigrid
    monkeypatch.setattr(contact_stiffness, "first_room", lambda _: math.inf if direct else 0.0)
    problem = make_block(3)
    assert problem.body.stiffness.explicit is direct
    if direct:
        assert problem.solve().certificate.passed
